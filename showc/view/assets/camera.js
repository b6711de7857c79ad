// An orbit camera: it looks from a distance at a target, z is up.

const FIELD_OF_VIEW = (40 * Math.PI) / 180;

const camera = { azimuth: 0, elevation: 0, distance: 1, target: [0, 0, 0], follow: false, aside: 0 };

function multiply(a, b) {
  const result = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++)
        result[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return result;
}

// Unit vectors to the right, upwards and forward of the camera.
function cameraAxes() {
  const [ca, sa] = [Math.cos(camera.azimuth), Math.sin(camera.azimuth)];
  const [ce, se] = [Math.cos(camera.elevation), Math.sin(camera.elevation)];
  return { right: [ca, sa, 0], up: [-sa * se, ca * se, ce], forward: [-sa * ce, ca * ce, -se] };
}

function eyePlace() {
  const { forward } = cameraAxes();
  return camera.target.map((value, axis) => value - camera.distance * forward[axis]);
}

function viewProjection(width, height) {
  const { right, up, forward } = cameraAxes();
  const eye = eyePlace();
  const dot = (v) => v[0] * eye[0] + v[1] * eye[1] + v[2] * eye[2];
  const view = new Float32Array([
    right[0], up[0], -forward[0], 0,
    right[1], up[1], -forward[1], 0,
    right[2], up[2], -forward[2], 0,
    -dot(right), -dot(up), dot(forward), 1,
  ]);
  const near = Math.max(camera.distance / 100, 0.05);
  const far = camera.distance * 8 + 2000;
  const f = 1 / Math.tan(FIELD_OF_VIEW / 2);
  const projection = new Float32Array(16);
  projection[0] = (f * height) / width;
  projection[5] = f;
  // What stands beside the picture pushes its middle aside, as a share of half the page.
  projection[8] = -camera.aside;
  projection[10] = (far + near) / (near - far);
  projection[11] = -1;
  projection[14] = (2 * far * near) / (near - far);
  return multiply(projection, view);
}

// Place on the page [CSS pixels] and depth of a point; depth <= 0 is behind the eye.
function project(matrix, point, width, height) {
  const out = [0, 0, 0, 0];
  for (let row = 0; row < 4; row++)
    out[row] = matrix[row] * point[0] + matrix[4 + row] * point[1]
      + matrix[8 + row] * point[2] + matrix[12 + row];
  return [(out[0] / out[3] * 0.5 + 0.5) * width, (0.5 - out[1] / out[3] * 0.5) * height, out[3]];
}

// Look at the whole show from one of three sides, with room for the timeline below.
function lookAt(view, width, height) {
  const [low, high] = show.bounds;
  const half = low.map((value, axis) => Math.max((high[axis] - value) / 2, 2));
  const fit = Math.tan(FIELD_OF_VIEW / 2);
  const wide = ((1 - Math.abs(camera.aside)) * width) / height;
  camera.follow = false;
  camera.target = low.map((value, axis) => (value + high[axis]) / 2);
  camera.azimuth = 0;
  if (view === "top") {
    camera.elevation = Math.PI / 2 - 1e-3;
    camera.distance = (1.3 * Math.max(half[1], half[0] / wide)) / fit + half[2];
    camera.target[1] -= 0.1 * camera.distance * fit;
    return;
  }
  const across = view === "front" ? half[0] : Math.hypot(half[0], half[1]);
  const deep = view === "front" ? half[1] : across;
  camera.distance = (1.3 * Math.max(half[2], across / wide)) / fit + 0.7 * deep;
  camera.target[2] -= 0.14 * camera.distance * fit;
  if (view === "front") {
    // Eyes of a spectator on the ground.
    camera.elevation = -Math.asin(Math.min((camera.target[2] - low[2] - 1.7) / camera.distance, 0.4));
  } else {
    camera.azimuth = -0.45;
    camera.elevation = 0.1;
  }
}
