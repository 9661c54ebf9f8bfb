"use strict";

// Measured and predicted torque of each joint, residual below. All samples are kept; shown are the extremes of as
// many intervals as the plot can resolve, taken anew for each zoom, so that no peak is ever lost.
function torquePlots(torque, config) {
  const INTERVALS = 900;
  const place = (name) => document.getElementById(name);
  const select = place("torque-choice");

  const floats = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  };
  const unpack = (log) => log.unpacked ||= log.joints.map((joint) => ({
    time: floats(joint.time),
    measured: floats(joint.measured),
    predicted: joint.predicted.map(floats),
    residual: joint.residual.map(floats),
    interval: joint.interval ? floats(joint.interval) : null,
  }));

  const first = (time, value) => {
    let low = 0, high = time.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] < value) low = middle + 1; else high = middle;
    }
    return low;
  };

  const extremes = (time, values, from, to) => {
    const begin = Math.max(0, first(time, from) - 1), end = Math.min(time.length, first(time, to) + 1);
    const x = [], y = [];
    const keep = (k) => { x.push(time[k]); y.push(Number.isFinite(values[k]) ? values[k] : null); };
    if (end - begin <= 2 * INTERVALS) {
      for (let k = begin; k < end; k++) keep(k);
      return { x, y };
    }
    for (let interval = 0; interval < INTERVALS; interval++) {
      const start = begin + Math.floor(interval * (end - begin) / INTERVALS);
      const stop = begin + Math.floor((interval + 1) * (end - begin) / INTERVALS);
      let least = start, most = start, gap = -1;
      for (let k = start; k < stop; k++) {
        if (!Number.isFinite(values[k])) { gap = k; continue; }
        if (!(values[k] >= values[least])) least = k;
        if (!(values[k] <= values[most])) most = k;
      }
      const kept = [...new Set([least, most, ...(gap < 0 ? [] : [gap])])].sort((a, b) => a - b);
      kept.forEach(keep);
    }
    return { x, y };
  };

  const traces = (joint, from, to) => {
    const line = (values, axis, name, colour, width, shown) => ({
      ...extremes(joint.time, values, from, to), type: "scatter", mode: "lines", name, legendgroup: name, yaxis: axis,
      showlegend: shown, line: { color: colour, width }, hovertemplate: "%{y:.4g}",
    });
    const upper = [line(joint.measured, "y", "measured", torque.measured_colour, 2.4, true)];
    const lower = [];
    if (joint.interval) {
      const edge = (sign, fill) => ({
        ...line(joint.interval.map((half) => sign * half), "y2", "interval", torque.interval_colour, 0.5, false),
        fill, fillcolor: torque.interval_colour, hoverinfo: "skip", hovertemplate: null,
      });
      lower.push(edge(-1, "none"), edge(1, "tonexty"));
    }
    torque.models.forEach((model, k) => {
      upper.push(line(joint.predicted[k], "y", model.label, model.colour, 1.2, true));
      lower.push(line(joint.residual[k], "y2", model.label, model.colour, 1.2, false));
    });
    return [...upper, ...lower];
  };

  // Room for all that is measured, and for what is predicted where it counts: the ends of a stretch, where derivatives
  // are uncertain, would otherwise dwarf the rest.
  const ranges = (shown, bands) => Object.fromEntries(["y", "y2"].map((axis) => {
    let low = Infinity, high = -Infinity;
    for (const trace of shown.filter((trace) => trace.yaxis === axis)) {
      let band = 0;
      trace.x.forEach((time, k) => {
        while (band < bands.length && bands[band][1] < time) band++;
        const counts = trace.name === "measured" || band === bands.length || time < bands[band][0];
        if (!counts || trace.y[k] === null) return;
        low = Math.min(low, trace.y[k]);
        high = Math.max(high, trace.y[k]);
      });
    }
    const margin = 0.06 * (high - low) || 1;
    const range = low <= high ? [low - margin, high + margin] : [-1, 1];
    return [axis === "y" ? "yaxis" : "yaxis2", range];
  }));

  // All joints show the same time.
  let range = [0, torque.logs[Number(select.value)].duration];

  const draw = (div, index) => {
    const log = torque.logs[Number(select.value)];
    const joint = unpack(log)[index];
    const shown = traces(joint, ...range);
    const bands = log.joints[index].not_counted.map(([x0, x1]) => ({
      type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1, layer: "below", line: { width: 0 },
      fillcolor: torque.not_counted_colour,
    }));
    const layout = structuredClone(torque.layouts[index]);
    layout.shapes = bands;
    layout.xaxis.range = [...range];
    for (const [axis, values] of Object.entries(ranges(shown, log.joints[index].not_counted))) layout[axis].range = values;
    return Plotly.react(div, shown, layout, config);
  };

  const divs = torque.layouts.map((_, index) => place("torque-" + index));
  const all = (given) => {
    range = given ?? [0, torque.logs[Number(select.value)].duration];
    divs.forEach(draw);
  };
  divs.forEach((div, index) => {
    div.removeAllListeners?.("plotly_relayout");
    draw(div, index);
    div.on("plotly_relayout", (change) => {
      if (change["xaxis.autorange"]) return all(null);
      const given = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
      if (given[0] !== undefined) all(given.map(Number));
    });
  });
  select.onchange = () => all(null);
}
