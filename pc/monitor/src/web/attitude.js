"use strict";
// The housing turned by its slopes: a box for A, a dashed one for B.
//
// In: slopes in degrees, null where there are none. Slope X is how far the X axis rises above the
// horizontal, slope Y the same of Y; heading is not measured and taken as 0.

const Attitude = (() => {
  const SIZE = [1.5, 1.0, 0.35];
  const FACES = [
    [0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5],
  ];
  const EDGES = [
    [0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4],
    [0, 4], [1, 5], [2, 6], [3, 7],
  ];

  // Directions of the housing's axes in the world.
  function axes(xDeg, yDeg) {
    const ux = Math.sin(xDeg * Math.PI / 180);
    let uy = Math.sin(yDeg * Math.PI / 180);
    const cx = Math.sqrt(Math.max(0, 1 - ux * ux));
    // Both slopes together can't be steeper than the vertical.
    uy = Math.max(-cx, Math.min(cx, uy));
    const x = [cx, 0, ux];
    const ax = cx > 1e-9 ? -ux * uy / cx : 0;
    const y = [ax, Math.sqrt(Math.max(0, 1 - ax * ax - uy * uy)), uy];
    const z = [
      x[1] * y[2] - x[2] * y[1],
      x[2] * y[0] - x[0] * y[2],
      x[0] * y[1] - x[1] * y[0],
    ];
    return [x, y, z];
  }

  // Seen from the front, from the right and a little from above.
  function project(p, width, height) {
    const turn = 0.3, tip = 0.3;
    const x = p[0] * Math.cos(turn) + p[1] * Math.sin(turn);
    const y = -p[0] * Math.sin(turn) + p[1] * Math.cos(turn);
    const up = p[2] * Math.cos(tip) + y * Math.sin(tip);
    const scale = Math.min(width, height * 1.4) / 2.8;
    return [width / 2 + x * scale, height / 2 - up * scale];
  }

  function corners(frame) {
    const all = [];
    for (let n = 0; n < 8; n += 1) {
      const signs = [n & 4 ? 1 : -1, n & 2 ? 1 : -1, n & 1 ? 1 : -1];
      const p = [0, 0, 0];
      for (let axis = 0; axis < 3; axis += 1) {
        for (let k = 0; k < 3; k += 1) {
          p[k] += signs[axis] * SIZE[axis] / 2 * frame[axis][k];
        }
      }
      all.push(p);
    }
    return all;
  }

  function line(ink, from, to, width, height) {
    const [a, b] = [project(from, width, height), project(to, width, height)];
    ink.beginPath();
    ink.moveTo(a[0], a[1]);
    ink.lineTo(b[0], b[1]);
    ink.stroke();
  }

  function fill(ink, points, width, height) {
    ink.globalAlpha = 0.12;
    for (const face of FACES) {
      ink.beginPath();
      face.forEach((n) => ink.lineTo(...project(points[n], width, height)));
      ink.fill();
    }
    ink.globalAlpha = 1;
  }

  function box(ink, slopes, colour, dash, width, height) {
    const frame = axes(slopes[0], slopes[1]);
    const points = corners(frame);
    ink.fillStyle = colour;
    if (dash.length === 0) {
      fill(ink, points, width, height);
    }
    ink.strokeStyle = colour;
    ink.setLineDash(dash);
    ink.lineWidth = 2;
    for (const [from, to] of EDGES) {
      line(ink, points[from], points[to], width, height);
    }
    // The X axis, by which the ends are told apart.
    const tip = frame[0].map((v) => v * 1.25);
    line(ink, [0, 0, 0], tip, width, height);
    const at = project(tip, width, height);
    ink.fillStyle = colour;
    ink.fillText("X", at[0] + 4, at[1]);
  }

  function draw(canvas, a, b, old) {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const ink = canvas.getContext("2d");
    const { width, height } = canvas;
    ink.clearRect(0, 0, width, height);
    ink.font = "14px system-ui, sans-serif";
    ink.setLineDash([]);
    ink.lineWidth = 1;
    ink.strokeStyle = colour("--grid");
    for (let n = -2; n <= 2; n += 1) {
      line(ink, [n * 0.5, -1, -0.6], [n * 0.5, 1, -0.6], width, height);
      line(ink, [-1, n * 0.5, -0.6], [1, n * 0.5, -0.6], width, height);
    }
    const whole = (slopes) => !old && slopes.every((v) => v !== null);
    if (whole(a)) {
      box(ink, a, colour("--a"), [], width, height);
    }
    if (whole(b)) {
      box(ink, b, colour("--b"), [5, 4], width, height);
    }
    if (!whole(a) && !whole(b)) {
      ink.fillStyle = colour("--soft");
      ink.fillText("no angle", 12, 22);
    }
  }

  return { draw, axes };
})();
