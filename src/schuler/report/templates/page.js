"use strict";
(function () {
  const content = JSON.parse(document.getElementById("data").textContent);
  if (!content.figures.length) return;

  // The pool: base64 of float32 ("f4"), or of 16-bit steps ("i2"; -32768 is a gap), little-endian.
  const arrays = content.pool.map(function (entry) {
    const text = atob(entry.d), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const view = new DataView(bytes.buffer);
    const wide = entry.k === "f4", out = new Float64Array(bytes.length / (wide ? 4 : 2));
    for (let i = 0; i < out.length; i++) {
      if (wide) { out[i] = view.getFloat32(4 * i, true); continue; }
      const step = view.getInt16(2 * i, true);
      out[i] = step === -32768 ? NaN : entry.o + entry.s * step;
    }
    return out;
  });
  const array = (ref) => (ref && ref.$ !== undefined ? arrays[ref.$] : ref);

  // A band is one closed outline for each stretch without gaps.
  function band(trace) {
    const b = trace.band, x = array(b.x), mid = array(b.mid), std = array(b.std), xs = [], ys = [];
    const ok = (i) => isFinite(std[i]) && (!mid || isFinite(mid[i]));
    for (let i = 0; i < x.length; i++) {
      if (!ok(i)) continue;
      let j = i;
      while (j + 1 < x.length && ok(j + 1)) j++;
      if (xs.length) { xs.push(NaN); ys.push(NaN); }
      for (let k = i; k <= j; k++) { xs.push(x[k]); ys.push((mid ? mid[k] : 0) + b.k * std[k]); }
      for (let k = j; k >= i; k--) { xs.push(x[k]); ys.push((mid ? mid[k] : 0) - b.k * std[k]); }
      xs.push(x[i]); ys.push((mid ? mid[i] : 0) + b.k * std[i]);
      i = j;
    }
    const out = Object.assign({ type: "scatter", mode: "lines", fill: "toself", hoverinfo: "skip" }, trace, { x: xs, y: ys });
    delete out.band;
    return out;
  }

  function real(trace) {
    if (trace.band) return band(trace);
    const out = Object.assign({}, trace);
    for (const key of ["x", "y", "customdata"]) if (out[key]) out[key] = array(out[key]);
    return out;
  }

  const ink = "#1f2530", soft = "#5b6573", rule = "#e6e9ee";
  const font = getComputedStyle(document.body).fontFamily;
  function dress(layout) {
    for (const key of Object.keys(layout)) {
      if (!/^[xy]axis/.test(key)) continue;
      layout[key] = Object.assign({
        gridcolor: rule, zerolinecolor: "#b9c1cc", zerolinewidth: 1, linecolor: "#b9c1cc", showline: true,
        ticks: "outside", ticklen: 4, tickcolor: "#b9c1cc", tickfont: { size: 11, color: soft }, automargin: false,
      }, layout[key]);
      layout[key].title = Object.assign({ font: { size: 12, color: soft } }, layout[key].title);
    }
    return Object.assign({
      font: { family: font, size: 12, color: ink }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", xanchor: "left", font: { size: 12 }, itemwidth: 30 },
      hoverlabel: { bgcolor: "#ffffff", bordercolor: "#b9c1cc", font: { family: font, size: 12, color: ink } },
      modebar: { bgcolor: "rgba(255,255,255,0.85)", color: "#a4adb9", activecolor: "#0072b2", orientation: "h" },
      dragmode: "zoom",
    }, layout);
  }

  const follows = [];
  let busy = false;
  function follow(source, change) {
    if (busy) return;
    let range = null;
    if (change["xaxis.range[0]"] !== undefined) range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    else if (change["xaxis.range"]) range = change["xaxis.range"].slice();
    else if (!change["xaxis.autorange"]) return;
    busy = true;
    const done = follows.filter((f) => f.node !== source).map((f) =>
      Plotly.relayout(f.node, { "xaxis.range": (range || f.whole).slice(), "xaxis.autorange": false }));
    Promise.all(done).finally(function () { busy = false; });
  }

  for (const figure of content.figures) {
    const node = document.getElementById(figure.id);
    Plotly.newPlot(node, figure.data.map(real), dress(figure.layout), {
      responsive: true,
      displaylogo: false,
      displayModeBar: window.innerWidth > 640 ? "hover" : false,
      modeBarButtons: [["zoom2d", "pan2d", "resetScale2d", "toImage"]],
      toImageButtonOptions: { format: "svg", filename: figure.id.replace(/^fig-/, "schuler-") },
    });
    if (figure.time) {
      follows.push({ node: node, whole: figure.layout.xaxis.range.slice() });
      node.on("plotly_relayout", (change) => follow(node, change));
    }
  }
  document.documentElement.dataset.drawn = String(content.figures.length);

  // Paper is narrower than a screen.
  const nodes = content.figures.map((f) => document.getElementById(f.id));
  window.addEventListener("beforeprint", function () {
    for (const n of nodes) Plotly.relayout(n, { width: n.parentElement.className === "half" ? 330 : 680 });
  });
  window.addEventListener("afterprint", function () {
    for (const n of nodes) Plotly.relayout(n, { width: null, autosize: true });
  });
})();
