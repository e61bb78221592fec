"use strict";
// The page: takes what the program sends four times a second, and shows it.
//
// Whatever comes is put in as text, never as markup. What is old is never shown as a number:
// when nothing has come for three seconds, everything counts as old.

const OLD_MS = 3000;
const KEPT = 700;
const EVENTS_SHOWN = 200;
const SPANS = { 60: 0.1, 600: 1, 6000: 10 };

const page = {
  state: null,
  traces: [],
  events: [],
  instrument: 0,
  axis: 0,
  span: 60,
  coarse: [],
  heard: 0,
  live: false,
};

const byId = (id) => document.getElementById(id);

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) {
    made.textContent = text;
  }
  if (className) {
    made.className = className;
  }
  return made;
}

// What was known before the connection went is not known now.
function known(value) {
  return page.live ? value : "--";
}

function degrees(value) {
  return value === null || !page.live ? "--" : `${value >= 0 ? "+" : ""}${value.toFixed(3)}`;
}

function clock(s) {
  if (s < 315532800) {
    return `${s.toFixed(1)} s`;
  }
  return new Date(s * 1000).toISOString().slice(11, 21);
}

function list(pairs) {
  const made = element("dl");
  for (const [name, value, className] of pairs) {
    made.append(element("dt", name), element("dd", value, className));
  }
  return made;
}

function angle(name, value, reason) {
  const made = element("div");
  made.append(element("small", `${name}, deg`), element("b", degrees(value)));
  if (value === null && reason) {
    made.append(element("small", reason));
  }
  return made;
}

function showChannel(channel, holder) {
  const angles = element("div", undefined, "angle");
  angles.append(
    angle("X", channel.slope_x_deg, channel.slope_x_reason),
    angle("Y", channel.slope_y_deg, channel.slope_y_reason),
  );
  const or = (value, unit) => (value === null || !page.live ? "--" : `${value} ${unit}`);
  const faults = channel.faults.map((fault) => fault.text);
  const heartbeat = channel.heartbeat_lost ? "LOST"
    : channel.nmt === null ? "none yet" : "received";
  const uncertainty = channel.uncertainty_deg;
  const findings = channel.findings.map((found) => `${found.count} ${found.text}`);
  holder.replaceChildren(
    element("h2", `Channel ${channel.name}, node ${channel.node_id}`),
    angles,
    list([
      ["validity", known(channel.validity_text ?? "stale")],
      ["uncertainty, k = 2", or(uncertainty === null ? null : uncertainty.toFixed(3), "deg")],
      ["temperature", or(channel.temperature_degc, "degC")],
      ["latency", or(channel.latency_ms, "ms")],
      ...motion(channel),
      ["state", known(channel.nmt ?? "not known")],
      ["heartbeat", known(heartbeat), channel.heartbeat_lost ? "fault" : ""],
      ["does not fit", findings.join("; ") || "nothing", findings.length ? "warning" : ""],
      ["restarts seen", String(channel.boots)],
      ["faults", known(faults.join("; ") || "none"), faults.length ? "fault" : ""],
    ]),
  );
}

// What only an instrument with a gyroscope tells, while it does.
function motion(channel) {
  const { slope_x_now_deg: x, slope_y_now_deg: y, rates_deg_s: rates } = channel;
  const number = (value) => (value === undefined ? "--" : value.toFixed(3));
  const rows = [];
  if (page.live && (x !== undefined || y !== undefined)) {
    rows.push(["angle now", `${number(x)}, ${number(y)} deg`]);
  }
  if (page.live && rates !== undefined) {
    const axes = rates.map((rate) => rate.toFixed(2));
    rows.push(["rate of turn", `${axes.join(", ")} deg/s`]);
  }
  return rows;
}

function showPair(instrument) {
  const angles = element("div", undefined, "angle");
  angles.append(
    angle("X", instrument.difference_x_deg, instrument.difference_reason),
    angle("Y", instrument.difference_y_deg, instrument.difference_reason),
  );
  const band = instrument.band_deg;
  const inside = instrument.inside_band;
  const word = inside === null ? "--" : inside ? "inside its band" : "beyond its band, as 1 of 20 is";
  byId("pair").replaceChildren(
    element("h2", "Difference A-B"),
    angles,
    list([
      ["band, k = 2", band === null || !page.live ? "--" : `${band.toFixed(3)} deg`],
      ["of", instrument.difference_of === "measured" ? "angles as measured"
        : "slopes, with their presets"],
      ["difference", page.live ? word : "--", inside === false ? "warning" : ""],
      ["blamed", known(instrument.verdict.blamed.join(" and ") || "none")],
      ["because", known(instrument.verdict.reason ?? "--")],
    ]),
  );
}

function showBus(bus) {
  const load = bus.load_percent === null ? bus.load_reason
    : `${bus.load_percent.toFixed(1)} % of ${bus.bit_rate_per_s / 1000} kbit/s`;
  const recording = bus.recording === null ? "no"
    : bus.recording_reason ? `ended: ${bus.recording_reason}`
      : `${bus.recording}, ${bus.recorded} frames`;
  byId("bus").replaceChildren(element("h2", "Bus"), list([
    ["load", page.live ? load : "--"],
    ["bits on the wire", page.live ? `${(bus.bits_per_s / 1000).toFixed(1)} kbit/s` : "--"],
    ["frames", page.live ? `${bus.frames_per_s} /s, ${bus.frames} in all` : "--"],
    ["SYNC", page.live ? `${bus.syncs_per_s} /s` : "--"],
    ["malformed", String(bus.malformed), bus.malformed ? "warning" : ""],
    ["unreadable lines", String(bus.unreadable), bus.unreadable ? "warning" : ""],
    ["of others", String(bus.others)],
    ["recording", recording, bus.recording_reason ? "fault" : ""],
  ]));
}

const WORDS = { good: "ok", unknown: "?", warning: "warning", fault: "FAULT" };

function showEvents() {
  const rows = page.events.slice(-EVENTS_SHOWN).reverse().map((event) => {
    const row = element("tr");
    const times = event.times > 1 ? ` (${event.times} times)` : "";
    const channel = event.channel === null ? ""
      : event.instrument > 1 ? `${event.channel} of ${event.instrument}` : event.channel;
    row.append(
      element("td", clock(event.time_s)),
      element("td", WORDS[event.level], event.level),
      element("td", channel),
      element("td", event.text + times),
    );
    return row;
  });
  byId("events").replaceChildren(...rows);
}

function showInstruments(all) {
  const nav = byId("instruments");
  nav.hidden = all.length < 2;
  if (nav.hidden || nav.childElementCount === all.length) {
    return;
  }
  nav.replaceChildren(...all.map((_, number) => {
    const button = element("button", `instrument ${number + 1}`);
    button.type = "button";
    button.addEventListener("click", () => {
      page.instrument = number;
      page.coarse = [];
      fetchTrace();
      show();
    });
    return button;
  }));
}

function showLink() {
  const link = byId("link");
  link.className = page.live ? "live" : "lost";
  link.textContent = page.live ? "live"
    : page.heard === 0 ? "connecting"
      : "no connection to plumb monitor: it has ended, or the network is gone; trying again";
  document.body.classList.toggle("old", !page.live);
}

function showVerdict(instrument, bus) {
  const holder = byId("verdict");
  if (!page.live) {
    holder.className = "";
    holder.textContent = "not known: no data from plumb monitor";
    return;
  }
  const { level, text, reason } = instrument.verdict;
  const why = reason ? ` (${reason})` : "";
  const source = bus.state === "running" || !bus.state_text ? "" : ` [${bus.state_text}]`;
  holder.className = level;
  holder.textContent = `${WORDS[level]}: ${text}${why}${source}`;
}

function showCharts(instrument) {
  const fine = page.traces[page.instrument] ?? [];
  const points = page.span === 60 ? fine : page.coarse;
  const holder = { slopes: byId("slopes"), difference: byId("difference") };
  const time = { spanS: page.span, widthS: SPANS[page.span], endS: page.state.time_s };
  Charts.show(holder, points, page.axis, time, instrument.band_deg);
  for (const button of document.querySelectorAll("[data-axis]")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.axis) === page.axis));
  }
  for (const button of document.querySelectorAll("[data-span]")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.span) === page.span));
  }
}

function show() {
  showLink();
  if (page.state === null) {
    return;
  }
  const { bus, instruments, time_s: time } = page.state;
  const instrument = instruments[page.instrument] ?? instruments[0];
  byId("source").textContent = `${bus.name}, ${clock(time)}`;
  showInstruments(instruments);
  showVerdict(instrument, bus);
  instrument.channels.forEach((channel, n) => showChannel(channel, byId(`channel${n}`)));
  showPair(instrument);
  showBus(bus);
  showCharts(instrument);
  const slopes = instrument.channels.map((c) => [c.slope_x_deg, c.slope_y_deg]);
  Attitude.draw(byId("housing"), slopes[0], slopes[1], !page.live);
}

function take(message) {
  page.heard = Date.now();
  page.live = true;
  page.state = message.state;
  if (message.events_anew) {
    page.events = [];
  }
  if (message.events.length > 0 || message.events_anew) {
    page.events.push(...message.events);
    page.events.splice(0, page.events.length - KEPT);
    showEvents();
  }
  message.traces.forEach((trace, number) => {
    if (trace.anew || !page.traces[number]) {
      page.traces[number] = [];
    }
    page.traces[number].push(...trace.points);
    page.traces[number].splice(0, page.traces[number].length - KEPT);
  });
  show();
}

async function fetchTrace() {
  if (page.span === 60 || !page.live) {
    return;
  }
  const { span, instrument } = page;
  try {
    const answer = await fetch(`/trace/${span}/${instrument + 1}`);
    const trace = await answer.json();
    if (span === page.span && instrument === page.instrument) {
      page.coarse = trace.points;
    }
  } catch {
    // The stream of events finds out that nobody is there.
  }
}

function listen() {
  const stream = new EventSource("/events");
  stream.addEventListener("message", (event) => take(JSON.parse(event.data)));
  stream.addEventListener("error", () => {
    page.live = false;
    show();
    if (stream.readyState === EventSource.CLOSED) {
      setTimeout(listen, 1000);
    }
  });
}

document.querySelector(".choices").addEventListener("click", (event) => {
  const { axis, span } = event.target.dataset;
  if (axis !== undefined) {
    page.axis = Number(axis);
  }
  if (span !== undefined) {
    page.span = Number(span);
    page.coarse = [];
    fetchTrace();
  }
  show();
});

setInterval(() => {
  if (page.live && Date.now() - page.heard > OLD_MS) {
    page.live = false;
    show();
  }
}, 500);
setInterval(fetchTrace, 2000);
listen();
