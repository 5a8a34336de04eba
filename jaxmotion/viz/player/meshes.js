// Two shapes that every picture is made of: a bone, drawn between two points, and a ball.
//
// A vertex is (x, y, z, along): the point `along` of the way, and from there x, y, z radii in the
// bone's own axes (y points along it). Then its normal.

const BONE_PROFILE = [
  // along, radii, slope of the surface
  [0.0, 0.3, -0.9],
  [0.035, 0.72, -0.8],
  [0.1, 0.98, -0.3],
  [0.17, 1.0, 0.08],
  [1.0, 0.42, 0.08],
];

function boneMesh(sides = 12) {
  const vertices = [];
  for (const [along, radius, slope] of BONE_PROFILE)
    for (let k = 0; k <= sides; k++) {
      const turn = (2 * Math.PI * k) / sides;
      const [c, s] = [Math.cos(turn), Math.sin(turn)];
      const normal = normalized([c, slope, s]);
      vertices.push(radius * c, 0, radius * s, along, ...normal);
    }
  return { vertices: new Float32Array(vertices), indices: patches(BONE_PROFILE.length, sides) };
}

function ballMesh(rings = 8, sides = 12) {
  const vertices = [];
  for (let r = 0; r <= rings; r++) {
    const polar = Math.PI * (r / rings - 0.5);
    for (let k = 0; k <= sides; k++) {
      const turn = (2 * Math.PI * k) / sides;
      const level = Math.cos(polar);
      const point = [level * Math.cos(turn), Math.sin(polar), level * Math.sin(turn)];
      vertices.push(...point, 0, ...point);
    }
  }
  return { vertices: new Float32Array(vertices), indices: patches(rings + 1, sides) };
}

// Triangles between rings of vertices, turning left seen from outside.
function patches(rings, sides) {
  const indices = [];
  for (let r = 0; r + 1 < rings; r++)
    for (let k = 0; k < sides; k++) {
      const a = r * (sides + 1) + k;
      const b = a + sides + 1;
      indices.push(a, b, a + 1, b, b + 1, a + 1);
    }
  return new Uint16Array(indices);
}
