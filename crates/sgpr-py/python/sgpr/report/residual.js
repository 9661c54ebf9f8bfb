"use strict";

// The residual against a chosen variable: samples, mean and the band of two thirds of groups of equally many samples.
function residualPlot(data, config, shades) {
  const GROUPS = 40, FEWEST = 8;
  const place = document.getElementById("residual-plot");
  const selects = ["joint", "x", "log"].map((name) => document.getElementById("residual-" + name));
  const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const values = data.values.map(floats), log = floats(data.log);
  const residuals = data.residuals.map((joints) => joints.map(floats));
  const faint = (colour, share) => colour + Math.round(255 * share).toString(16).padStart(2, "0");

  // Groups do not reach over a gap: a line through it would be made up.
  const grouped = (pairs) => {
    const size = Math.max(FEWEST, Math.ceil(pairs.length / GROUPS));
    const reach = pairs.length ? 0.05 * (pairs[pairs.length - 1][0] - pairs[0][0]) : 0;
    const groups = [[]];
    pairs.forEach((pair, k) => {
      const gap = k > 0 && pair[0] - pairs[k - 1][0] > reach;
      if (gap) groups.push(null, []);
      else if (groups[groups.length - 1].length >= size) groups.push([]);
      groups[groups.length - 1].push(pair);
    });
    return groups.filter((group) => group === null || group.length >= FEWEST);
  };

  const lines = (groups) => {
    const found = { x: [], mean: [], low: [], high: [] };
    for (const group of groups) {
      const y = group ? group.map((pair) => pair[1]).sort((a, b) => a - b) : [];
      const at = (share) => y[Math.min(y.length - 1, Math.floor(share * y.length))] ?? null;
      const average = (k) => (group ? group.reduce((sum, pair) => sum + pair[k], 0) / group.length : null);
      found.x.push(average(0)); found.mean.push(average(1)); found.low.push(at(1 / 6)); found.high.push(at(5 / 6));
    }
    return found;
  };

  const show = () => {
    const [joint, variable, which] = selects.map((select) => Number(select.value));
    const dots = [], means = [];
    data.models.forEach((model, m) => {
      const y = residuals[m][joint], pairs = [];
      for (let k = 0; k < y.length; k++) {
        if (Number.isFinite(y[k]) && (which === 0 || log[k] === which - 1)) pairs.push([values[variable][k], y[k]]);
      }
      pairs.sort((a, b) => a[0] - b[0]);
      const { x, mean, low, high } = lines(grouped(pairs));
      const common = { type: "scatter", mode: "lines", x, hoverinfo: "skip", showlegend: false, connectgaps: false };
      dots.push({ type: "scatter", mode: "markers", x: pairs.map((p) => p[0]), y: pairs.map((p) => p[1]), showlegend: false,
        marker: { color: faint(model.colour, 0.35), size: 3 }, hoverinfo: "skip" });
      for (const edge of [low, high]) means.push({ ...common, y: edge, line: { color: model.colour, width: 0.8, dash: "dot" } });
      means.push({ ...common, y: mean, name: model.label, line: { color: model.colour, width: 3 }, hoverinfo: "x+y" });
    });
    const axis = (text) => ({ title: { text: text.replaceAll("&", "&amp;").replaceAll("<", "&lt;"), standoff: 8 }, automargin: true, gridcolor: shades.grid, zerolinecolor: shades.zero });
    const layout = { xaxis: axis(data.variables[variable]), yaxis: axis(data.joints[joint]), margin: { l: 68, r: 12, t: 34, b: 48 },
      font: shades.font, paper_bgcolor: shades.paper, plot_bgcolor: shades.paper, hovermode: "closest" };
    Plotly.react(place, [...dots, ...means], layout, config);
  };
  // To begin with, the weakest joint against its speed; another joint takes its own variable along.
  if (!place.data) { selects[0].value = String(data.start); selects[1].value = String(2 + 4 * data.start); }
  let before = Number(selects[0].value);
  selects[0].onchange = () => {
    const now = Number(selects[0].value), variable = Number(selects[1].value);
    if (variable > 0 && Math.floor((variable - 1) / 4) === before) selects[1].value = String(variable + 4 * (now - before));
    before = now;
    show();
  };
  selects[1].onchange = selects[2].onchange = show;
  show();
}
