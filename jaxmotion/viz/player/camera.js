// A camera that goes round a target. Angles are radians; lengths the clips' own.

const UP = [0, 1, 0];

class Camera {
  constructor(size) {
    this.size = size; // of the figures
    this.target = [0, size / 2, 0];
    this.yaw = 0; // about Y, from Z to X
    this.pitch = 0.2; // above the target
    this.distance = 3 * size;
    this.fov = (35 * Math.PI) / 180;
  }

  get eye() {
    const level = Math.cos(this.pitch) * this.distance;
    const offset = [
      level * Math.sin(this.yaw),
      Math.sin(this.pitch) * this.distance,
      level * Math.cos(this.yaw),
    ];
    return add(this.target, offset);
  }

  set eye(eye) {
    const away = subtract(eye, this.target);
    this.distance = length(away) || this.size;
    this.pitch = clamp(Math.asin(away[1] / this.distance), -1.57, 1.57);
    this.yaw = Math.atan2(away[0], away[2]);
  }

  get view() {
    return lookAt(this.eye, this.target, UP);
  }

  // A picture that is higher than wide shows as much across as a square one.
  get near() {
    return Math.max(this.distance / 200, this.size / 500);
  }

  get far() {
    return this.distance + 60 * this.size;
  }

  // The same, looking at another place.
  moved(offset) {
    const other = Object.assign(new Camera(this.size), this);
    other.target = add(this.target, offset);
    return other;
  }

  projection(aspect) {
    return perspective(this.angleOf(aspect), aspect, this.near, this.far);
  }

  angleOf(aspect) {
    return aspect >= 1 ? this.fov : 2 * Math.atan(Math.tan(this.fov / 2) / aspect);
  }

  matrix(aspect) {
    return product(this.projection(aspect), this.view);
  }

  orbit(dx, dy) {
    this.yaw -= 0.008 * dx;
    this.pitch = clamp(this.pitch + 0.008 * dy, -1.55, 1.55);
  }

  // By pixels of a picture `height` high; what is at the target stays under the pointer.
  pan(dx, dy, height) {
    const view = this.view;
    const right = [view[0], view[4], view[8]];
    const above = [view[1], view[5], view[9]];
    const pixel = (2 * this.distance * Math.tan(this.fov / 2)) / height;
    this.target = add(this.target, add(scaled(right, -dx * pixel), scaled(above, dy * pixel)));
  }

  zoom(factor) {
    this.distance = clamp(this.distance * factor, 0.05 * this.size, 100 * this.size);
  }
}

// Where a point of the world is in a view {x, y, w, h} of the stage, in CSS pixels: [x, y, depth],
// null behind the camera.
function projected(point, matrix, view) {
  const [x, y, z] = point;
  const m = matrix;
  const w = m[3] * x + m[7] * y + m[11] * z + m[15];
  if (!(w > 1e-9)) return null;
  const across = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
  const up = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
  return [view.x + ((1 + across) / 2) * view.w, view.y + ((1 - up) / 2) * view.h, w];
}
