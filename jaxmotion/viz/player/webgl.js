// The picture by WebGL 2: instanced shapes, lit; their shadow, flattened on the floor; a grid.
// Colours are premultiplied by alpha, so that the page shows through.

const SHAPE_VERTEX = `#version 300 es
layout(location = 0) in vec4 shape;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 origin;
layout(location = 3) in vec3 end;
layout(location = 4) in float radius;
layout(location = 5) in vec4 colour;
uniform mat4 camera;
uniform vec3 light;
uniform int flatten; // 0 a body, 1 its shadow along the light, 2 a disc on the floor, 3 a ghost
uniform float lift;
out vec3 world;
out vec3 outward;
out vec4 tint;
void main() {
  vec3 axis = end - origin;
  float size = length(axis);
  vec3 y = size > 0.0 ? axis / size : vec3(0.0, 1.0, 0.0);
  vec3 other = abs(y.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
  vec3 x = normalize(cross(y, other));
  vec3 z = cross(x, y);
  world = mix(origin, end, shape.w) + radius * (shape.x * x + shape.y * y + shape.z * z);
  outward = normal.x * x + normal.y * y + normal.z * z;
  if (flatten == 1) world -= light * (max(world.y, 0.0) / light.y);
  if (flatten == 1 || flatten == 2) world.y = lift;
  tint = colour;
  gl_Position = camera * vec4(world, 1.0);
}`;

const SHAPE_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
in vec3 world;
in vec3 outward;
in vec4 tint;
uniform vec3 light;
uniform vec3 eye;
uniform vec4 sky; // and how strong the rim is
uniform int flatten;
uniform vec4 shade;
out vec4 pixel;
void main() {
  if (flatten == 1) { pixel = vec4(shade.rgb * shade.a, shade.a); return; }
  vec3 lit = tint.rgb;
  if (flatten == 0) {
    vec3 n = normalize(outward);
    vec3 back = normalize(eye - world);
    float direct = max(dot(n, light), 0.0);
    float around = 0.5 + 0.5 * n.y;
    float fill = max(dot(n, back), 0.0);
    float rim = pow(1.0 - fill, 3.0) * sky.a * around;
    vec3 half_way = normalize(light + back);
    float shine = pow(max(dot(n, half_way), 0.0), 40.0) * 0.18;
    lit = tint.rgb * (0.46 + 0.20 * around + 0.44 * direct + 0.10 * fill) + sky.rgb * rim + shine;
  }
  if (flatten == 3) lit = tint.rgb * (0.85 + 0.15 * normalize(outward).y);
  lit = min(lit, vec3(1.0));
  pixel = vec4(lit * tint.a, tint.a);
}`;

const GRID_VERTEX = `#version 300 es
layout(location = 0) in vec2 corner;
uniform mat4 camera;
uniform vec3 middle;
uniform float reach;
out vec2 place;
void main() {
  place = middle.xz + corner * reach;
  gl_Position = camera * vec4(place.x, 0.0, place.y, 1.0);
}`;

const GRID_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform vec3 middle;
uniform float reach;
uniform float cell;
uniform vec4 line;
out vec4 pixel;
float lines(float size, float width) {
  vec2 at = place / size;
  vec2 slope = max(fwidth(at), vec2(1e-6));
  vec2 away = abs(fract(at - 0.5) - 0.5) / slope;
  float ink = 1.0 - min(min(away.x, away.y) / width, 1.0);
  return ink * clamp(1.2 - 1.6 * max(slope.x, slope.y), 0.0, 1.0);
}
void main() {
  float far = length(place - middle.xz) / reach;
  float ink = max(0.42 * lines(cell, 1.0), lines(5.0 * cell, 1.25));
  float alpha = line.a * ink * (1.0 - smoothstep(0.12, 1.0, far));
  pixel = vec4(line.rgb * alpha, alpha);
}`;

const FLOATS = 11; // an instance: from, to, radius, colour

class WebGLPicture {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true });
    if (!gl) throw new Error("no WebGL 2");
    this.canvas = canvas;
    this.gl = gl;
    this.name = "webgl2";
    this.shapes = program(gl, SHAPE_VERTEX, SHAPE_FRAGMENT);
    this.grid = program(gl, GRID_VERTEX, GRID_FRAGMENT);
    this.instances = gl.createBuffer();
    this.data = new Float32Array(FLOATS * 512);
    this.bone = this.mesh(boneMesh());
    this.ball = this.mesh(ballMesh());
    this.square = gl.createVertexArray();
    gl.bindVertexArray(this.square);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, Float32Array.of(-1, -1, 1, -1, -1, 1, 1, 1), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  mesh({ vertices, indices }) {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    attribute(gl, 0, 4, 28, 0);
    attribute(gl, 1, 3, 28, 16);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    [
      [2, 3, 0],
      [3, 3, 12],
      [4, 1, 24],
      [5, 4, 28],
    ].forEach(([place, size, offset]) => {
      attribute(gl, place, size, 4 * FLOATS, offset);
      gl.vertexAttribDivisor(place, 1);
    });
    return { array, count: indices.length };
  }

  // `views`: {x, y, w, h, camera, lists: [of Scene.build]}; `look`: colours, light, cell, reach.
  draw(views, look, scale) {
    const { gl } = this;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    for (const view of views) {
      const box = [view.x, this.canvas.height / scale - view.y - view.h, view.w, view.h];
      const pixels = box.map((x) => Math.round(x * scale));
      gl.viewport(...pixels);
      gl.scissor(...pixels);
      this.drawView(view, look);
    }
  }

  drawView(view, look) {
    const { camera } = view;
    const { gl } = this;
    const matrix = new Float32Array(camera.matrix(view.w / view.h));
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(false);
    if (camera.eye[1] > 0) this.drawGrid(matrix, camera, look);
    const { at } = this.shapes;
    gl.useProgram(this.shapes.program);
    gl.uniformMatrix4fv(at("camera"), false, matrix);
    gl.uniform3fv(at("light"), look.light);
    gl.uniform3fv(at("eye"), camera.eye);
    gl.uniform4fv(at("sky"), look.sky);
    gl.uniform4fv(at("shade"), look.shade);
    const all = (name) => view.lists.flatMap((lists) => lists[name]);
    this.flat(2, 0.002 * camera.size, all("floor"));
    if (camera.eye[1] > 0) {
      gl.enable(gl.STENCIL_TEST); // a shadow on a shadow is no darker
      gl.stencilFunc(gl.EQUAL, 0, 255);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      this.flat(1, 0.001 * camera.size, all("solid"));
      gl.disable(gl.STENCIL_TEST);
    }
    gl.uniform1i(at("flatten"), 0);
    gl.enable(gl.CULL_FACE);
    gl.depthMask(true);
    gl.enable(gl.POLYGON_OFFSET_FILL); // where clips are the same the last is seen, whole
    view.lists.forEach((lists, k) => {
      gl.polygonOffset(-k, -4 * k);
      this.instanced(lists.solid);
    });
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.depthMask(false);
    gl.uniform1i(at("flatten"), 3);
    this.instanced(all("clear"));
    gl.disable(gl.CULL_FACE);
    gl.depthMask(true);
  }

  flat(how, lift, shapes) {
    const { gl } = this;
    const { at } = this.shapes;
    gl.uniform1i(at("flatten"), how);
    gl.uniform1f(at("lift"), lift);
    this.instanced(shapes);
  }

  drawGrid(matrix, camera, look) {
    const { gl } = this;
    const { at } = this.grid;
    gl.useProgram(this.grid.program);
    gl.bindVertexArray(this.square);
    gl.uniformMatrix4fv(at("camera"), false, matrix);
    gl.uniform3fv(at("middle"), [camera.target[0], 0, camera.target[2]]);
    gl.uniform1f(at("reach"), look.reach);
    gl.uniform1f(at("cell"), look.cell);
    gl.uniform4fv(at("line"), look.line);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  instanced(shapes) {
    const isBall = (shape) => shape.from === shape.to;
    this.drawMesh(
      this.bone,
      shapes.filter((shape) => !isBall(shape)),
    );
    this.drawMesh(this.ball, shapes.filter(isBall));
  }

  drawMesh(mesh, shapes) {
    if (!shapes.length) return;
    const { gl } = this;
    if (this.data.length < FLOATS * shapes.length)
      this.data = new Float32Array(2 * FLOATS * shapes.length);
    let k = 0;
    for (const { from, to, radius, colour } of shapes) {
      this.data.set(from, k);
      this.data.set(to, k + 3);
      this.data[k + 6] = radius;
      this.data.set(colour, k + 7);
      k += FLOATS;
    }
    gl.bindVertexArray(mesh.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, this.data.subarray(0, k), gl.STREAM_DRAW);
    gl.drawElementsInstanced(gl.TRIANGLES, mesh.count, gl.UNSIGNED_SHORT, 0, shapes.length);
  }

  // Wait until all that was asked for is drawn.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

function attribute(gl, place, size, stride, offset) {
  gl.enableVertexAttribArray(place);
  gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset);
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const places = new Map();
  const at = (name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(made, name));
    return places.get(name);
  };
  return { program: made, at };
}
