"use strict";
// The two charts: slopes of A and B, and their difference with its band.
//
// In: points as the program sends them: time in s, then least and greatest of each line in
// degrees, lines in the order slope X, Y of A, X, Y of B, difference in X, Y.

const Charts = (() => {
  const MOST = 700;
  let range = [0, 1];
  let slopes = null;
  let difference = null;

  function colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  function series(label, name, extra) {
    const value = (_, v) => (v === null ? "--" : `${v.toFixed(3)} deg`);
    return { label, stroke: colour(name), width: 1.5, value, points: { show: false }, ...extra };
  }

  function options(title, width, lines, bands, dated) {
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--grid") } };
    const clock = { ...axis };
    if (!dated) {
      clock.values = (_, all) => all.map((v) => `${v} s`);
    }
    return {
      title,
      width,
      height: 200,
      scales: { x: { time: dated, range: () => range } },
      tzDate: (s) => uPlot.tzDate(new Date(s * 1000), "Etc/UTC"),
      axes: [clock, { ...axis, size: 64 }],
      series: [{}, ...lines],
      bands,
      legend: { live: true },
      cursor: { drag: { x: false, y: false } },
    };
  }

  function make(holder, width, dated, name) {
    const a = colour("--a");
    const b = colour("--b");
    const d = colour("--d");
    slopes = new uPlot(options(`slope ${name}, deg`, width, [
      series("A", "--a"), series("A least", "--a", { width: 0.5 }),
      series("B", "--b"), series("B least", "--b", { width: 0.5 }),
    ], [
      { series: [1, 2], fill: `${a}40` },
      { series: [3, 4], fill: `${b}40` },
    ], dated), [[], [], [], [], []], holder.slopes);
    difference = new uPlot(options(`A-B in ${name} and its band (k = 2), deg`, width, [
      series("A-B", "--d"), series("A-B least", "--d", { width: 0.5 }),
      series("band", "--soft", { dash: [4, 4], width: 1 }),
      series("-band", "--soft", { dash: [4, 4], width: 1 }),
    ], [{ series: [1, 2], fill: `${d}40` }], dated), [[], [], [], [], []], holder.difference);
  }

  // Lines must not be drawn over what was not there.
  function withGaps(points, widthS) {
    const all = [];
    let before = null;
    for (const point of points) {
      if (before !== null && point[0] - before > 3 * widthS) {
        all.push([before + widthS]);
      }
      all.push(point);
      before = point[0];
    }
    return all;
  }

  function column(points, index) {
    return points.map((point) => (point.length > index ? point[index] : null));
  }

  // Shows points; builds the charts anew when axis, width or kind of time has changed.
  let built = "";
  function show(holder, points, axis, time, band) {
    const all = withGaps(points.slice(-MOST), time.widthS);
    range = [time.endS - time.spanS, time.endS];
    const width = Math.max(240, holder.slopes.clientWidth);
    const dated = time.endS > 315532800;
    const wanted = `${axis} ${width} ${dated} ${colour("--a")}`;
    if (wanted !== built) {
      built = wanted;
      holder.slopes.replaceChildren();
      holder.difference.replaceChildren();
      make(holder, width, dated, axis === 0 ? "X" : "Y");
    }
    const times = column(all, 0);
    const at = (line, high) => column(all, 1 + 2 * (line + axis) + (high ? 1 : 0));
    slopes.setData([times, at(0, true), at(0, false), at(2, true), at(2, false)]);
    // The band of now, over all of the time.
    const edge = (sign) => times.map(() => (band === null ? null : sign * band));
    difference.setData([times, at(4, true), at(4, false), edge(1), edge(-1)]);
  }

  return { show };
})();
