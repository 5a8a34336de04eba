// Vectors [x, y, z] and matrices of 16 numbers, column after column, as WebGL wants them.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const length = (a) => Math.hypot(a[0], a[1], a[2]);
const normalized = (a) => scaled(a, 1 / (length(a) || 1));
const mixed = (a, b, t) => add(scaled(a, 1 - t), scaled(b, t));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

function product(a, b) {
  const out = new Float64Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return out;
}

// From the world to the eye's axes: x right, y up, −z ahead.
function lookAt(eye, target, up) {
  const back = normalized(subtract(eye, target));
  const right = normalized(cross(up, back));
  const above = cross(back, right);
  // prettier-ignore
  return Float64Array.of(
    right[0], above[0], back[0], 0,
    right[1], above[1], back[1], 0,
    right[2], above[2], back[2], 0,
    -dot(right, eye), -dot(above, eye), -dot(back, eye), 1,
  );
}

// `fov` is the angle from the bottom of the picture to its top, radians.
function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2);
  // prettier-ignore
  return Float64Array.of(
    f / aspect, 0, 0, 0,
    0, f, 0, 0,
    0, 0, (far + near) / (near - far), -1,
    0, 0, (2 * far * near) / (near - far), 0,
  );
}

// The next of 1, 2, 5, 10, 20, … that is not larger.
function roundStep(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  const part = x / power;
  return power * (part >= 5 ? 5 : part >= 2 ? 2 : 1);
}

// "#rgb" or "#rrggbb" as three numbers from 0 to 1.
function colourOf(text) {
  const hex = text.trim().slice(1);
  const wide = hex.length === 3 ? [...hex].map((c) => c + c).join("") : hex;
  return [0, 2, 4].map((k) => parseInt(wide.slice(k, k + 2), 16) / 255);
}

const css = (c, alpha = 1) => `rgba(${c.slice(0, 3).map((x) => Math.round(255 * x))}, ${alpha})`;

// Three or four digits, whatever the size of a number.
function short(x) {
  if (!Number.isFinite(x)) return "–";
  const size = Math.abs(x);
  if (size && (size < 1e-3 || size >= 1e5)) return x.toExponential(2);
  return x.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}
