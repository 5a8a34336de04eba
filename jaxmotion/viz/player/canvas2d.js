// The same picture without WebGL: shapes from far to near, each shaded across.

class CanvasPicture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.name = "canvas2d";
  }

  draw(views, look, scale) {
    const c = this.context;
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    for (const view of views) {
      c.save();
      c.beginPath();
      c.rect(view.x, view.y, view.w, view.h);
      c.clip();
      this.drawView(view, look);
      c.restore();
    }
  }

  drawView(view, look) {
    const { camera } = view;
    const matrix = camera.matrix(view.w / view.h);
    const seen = (point) => projected(point, matrix, view);
    const focal = view.h / 2 / Math.tan(camera.angleOf(view.w / view.h) / 2);
    const all = (name) => view.lists.flatMap((lists) => lists[name]);
    if (camera.eye[1] > 0) {
      this.drawGrid(seen, camera, look);
      this.drawShadow(all("solid"), seen, focal, look);
    }
    for (const shape of all("floor")) this.drawDisc(shape, seen, focal, camera);
    // Where clips are the same the last is seen, whole: it counts as a little nearer.
    const nearer = (k) => 0.002 * k * camera.size;
    const shapes = view.lists
      .flatMap(({ solid, clear }, k) => [...solid, ...clear].map((shape) => [shape, nearer(k)]))
      .map(([shape, near]) => ({ shape, near, a: seen(shape.from), b: seen(shape.to) }))
      .filter(({ a, b }) => a && b && Math.min(a[2], b[2]) > camera.near)
      .map((one) => ({ ...one, depth: one.a[2] + one.b[2] - one.near }))
      .sort((one, other) => other.depth - one.depth);
    for (const { shape, a, b } of shapes)
      if (shape.from === shape.to) this.drawBall(shape, a, focal);
      else this.drawBone(shape, a, b, focal);
  }

  drawBone({ radius, colour, isLine }, a, b, focal) {
    const c = this.context;
    const outline = boneOutline(a, b, (radius * focal) / a[2], (radius * focal) / b[2], isLine);
    if (isLine) {
      c.fillStyle = css(colour, colour[3]);
    } else {
      const { across, wide } = outline;
      const fill = c.createLinearGradient(
        a[0] - across[0] * wide,
        a[1] - across[1] * wide,
        a[0] + across[0] * wide,
        a[1] + across[1] * wide,
      );
      fill.addColorStop(0, css(mixed(colour, [1, 1, 1], 0.22), colour[3]));
      fill.addColorStop(0.4, css(colour, colour[3]));
      fill.addColorStop(1, css(scaled(colour, 0.6), colour[3]));
      c.fillStyle = fill;
    }
    c.fill(outline.path);
  }

  drawBall({ radius, colour }, at, focal) {
    const c = this.context;
    const r = Math.max((radius * focal) / at[2], 0.4);
    const fill = c.createRadialGradient(
      at[0] - 0.35 * r,
      at[1] - 0.4 * r,
      0.1 * r,
      at[0],
      at[1],
      r,
    );
    fill.addColorStop(0, css(mixed(colour, [1, 1, 1], 0.4), colour[3]));
    fill.addColorStop(0.5, css(colour, colour[3]));
    fill.addColorStop(1, css(scaled(colour, 0.62), colour[3]));
    c.fillStyle = fill;
    c.beginPath();
    c.arc(at[0], at[1], r, 0, 2 * Math.PI);
    c.fill();
  }

  drawDisc({ from, radius, colour }, seen, focal, camera) {
    const at = seen(from);
    if (!at) return;
    const c = this.context;
    const r = (radius * focal) / at[2];
    c.fillStyle = css(colour, colour[3]);
    c.beginPath();
    c.ellipse(at[0], at[1], r, r * Math.abs(Math.sin(camera.pitch)), 0, 0, 2 * Math.PI);
    c.fill();
  }

  // One path, so that a shadow on a shadow is no darker.
  drawShadow(shapes, seen, focal, look) {
    const c = this.context;
    const path = new Path2D();
    const down = (p) => {
      const way = Math.max(p[1], 0) / look.light[1];
      return seen([p[0] - look.light[0] * way, 0, p[2] - look.light[2] * way]);
    };
    for (const { from, to, radius } of shapes) {
      const [a, b] = [down(from), down(to)];
      if (!a || !b || from === to) continue;
      path.addPath(boneOutline(a, b, (radius * focal) / a[2], (radius * focal) / b[2]).path);
    }
    c.fillStyle = css(look.shade, look.shade[3]);
    c.fill(path);
  }

  drawGrid(seen, camera, look) {
    const c = this.context;
    const middle = [camera.target[0], camera.target[2]];
    const reach = 0.35 * look.reach;
    c.lineWidth = 1;
    for (const [cell, ink] of [
      [look.cell, 0.3],
      [5 * look.cell, 0.8],
    ]) {
      const many = Math.min(Math.ceil(reach / cell), 60);
      for (const axis of [0, 1])
        for (let k = -many; k <= many; k++) {
          const at = (Math.round(middle[axis] / cell) + k) * cell;
          const far = Math.abs(at - middle[axis]) / reach;
          if (far >= 1) continue;
          const half = reach * Math.sqrt(1 - far * far);
          c.strokeStyle = css(look.line, look.line[3] * ink * (1 - far));
          const end = (t) => (axis === 0 ? [at, 0, middle[1] + t] : [middle[0] + t, 0, at]);
          for (let t = -half, step = half / 6; t < half - 1e-9; t += step) {
            const [a, b] = [seen(end(t)), seen(end(t + step))];
            if (!a || !b) continue;
            c.beginPath();
            c.moveTo(a[0], a[1]);
            c.lineTo(b[0], b[1]);
            c.stroke();
          }
        }
    }
  }

  finish() {
    this.context.getImageData(0, 0, 1, 1);
  }
}

// A bone from a to b on the screen, `ra` and `rb` pixels thick there; thickest near a.
function boneOutline(a, b, ra, rb, isLine = false) {
  const along = [b[0] - a[0], b[1] - a[1]];
  const long = Math.hypot(...along) || 1;
  const across = [-along[1] / long, along[0] / long];
  const wide = Math.max(ra, 0.5);
  const parts = isLine
    ? [
        [0, wide],
        [1, Math.max(rb, 0.5)],
      ]
    : [
        [0, 0.5 * wide],
        [0.15, wide],
        [1, Math.max(0.42 * rb, 0.4)],
      ];
  const path = new Path2D();
  const corner = ([t, r], side) => [
    a[0] + t * along[0] + side * r * across[0],
    a[1] + t * along[1] + side * r * across[1],
  ];
  const corners = [...parts.map((p) => corner(p, 1)), ...parts.reverse().map((p) => corner(p, -1))];
  corners.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
  path.closePath();
  return { path, across, wide };
}
