"use strict";

// Draws the plots of the page from the data that it carries. Nothing is loaded.
(function () {
  const text = document.getElementById("payload").textContent;
  // No button may offer to send anything anywhere.
  const config = {
    responsive: true, displaylogo: false, plotlyServerURL: "", showSendToCloud: false, showEditInChartStudio: false,
    modeBarButtonsToRemove: ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d"],
  };
  const place = (name) => document.getElementById(name);

  // Colours of the data are those of a light page; lines keep theirs, paper and ink change places.
  const DARK = {
    "#000000": "#f0f3f6", "#222222": "#e6edf3", "#ffffff": "#0d1117", "#e4e4e4": "#2d333b", "#bbbbbb": "#57606a", "#eeeeee": "#21262d",
    "#b9dcf0": "#1b4058", "#555555": "#adb5bd", "#0072b2": "#4ba3e3", "#d55e00": "#f0803c", "rgba(255,255,255,0.85)": "rgba(13,17,23,0.85)",
  };
  const wantsDark = matchMedia("(prefers-color-scheme: dark)");

  function drawAll(dark) {
    const shade = (light) => (dark ? DARK[light] ?? light : light);
    const payload = JSON.parse(dark ? text.replace(/#[0-9a-f]{6}\b|rgba\(255,255,255,0\.85\)/g, shade) : text);
    for (const [name, figure] of Object.entries(payload.figures || {})) {
      Plotly.react(place(name), figure.data, figure.layout, config);
    }
    // Plots of which a selection shows one.
    for (const [name, figures] of Object.entries(payload.switches || {})) {
      const show = (index) => Plotly.react(place(name), figures[index].data, figures[index].layout, config);
      const select = place(name + "-choice");
      select.onchange = () => show(Number(select.value));
      show(Number(select.value));
    }
    if (payload.torque) torquePlots(payload.torque, config);
    if (payload.residual) {
      const shades = { grid: shade("#e4e4e4"), zero: shade("#bbbbbb"), paper: shade("#ffffff"), font: { family: getComputedStyle(document.body).fontFamily, size: 13, color: shade("#222222") } };
      residualPlot(payload.residual, config, shades);
    }
  }

  drawAll(wantsDark.matches);
  wantsDark.addEventListener("change", () => drawAll(wantsDark.matches));

  // Paper is white and narrower than the window, and what is folded cannot be opened there.
  const PAPER_WIDTH = 670;
  const plots = () => document.querySelectorAll(".plot");
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((details) => { details.open = true; });
    if (wantsDark.matches) drawAll(false);
    plots().forEach((div) => Plotly.relayout(div, { width: PAPER_WIDTH }));
  });
  window.addEventListener("afterprint", () => {
    if (wantsDark.matches) drawAll(true);
    plots().forEach((div) => Plotly.relayout(div, { width: null, autosize: true }));
  });
})();
