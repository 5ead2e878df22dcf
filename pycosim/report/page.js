"use strict";
// Unpacks the library and the charts, draws what is shown, in the reader's theme, and never asks a server.
(async () => {
  const root = document.documentElement;
  const failed = document.getElementById("failed");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = () => root.dataset.theme;
  root.dataset.theme = dark.matches ? "dark" : "light";

  function bytes(text) {  // a plain loop: a call for each byte of the library takes half a second
    const found = atob(text), raw = new Uint8Array(found.length);
    for (let k = 0; k < found.length; k++) raw[k] = found.charCodeAt(k);
    return raw.buffer;
  }
  async function unpack(id) {
    return new Response(new Blob([bytes(document.getElementById(id).textContent.trim())]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  }
  if (!("DecompressionStream" in window)) {
    failed.textContent = "The charts need a browser of 2023 or later; words and tables do not.";
    failed.hidden = false;
    return;
  }
  const script = document.createElement("script");
  script.textContent = await unpack("plotly");
  document.head.append(script);
  const payload = JSON.parse(await unpack("payload"));

  const KINDS = { f4: Float32Array, f8: Float64Array };
  function numbers(value) {
    if (value === "@time") return numbers(payload.time);
    if (!value || !(value.bdata || value.steps)) return value;
    if (!value.array) value.array = value.bdata ? new KINDS[value.dtype](bytes(value.bdata)) : counted(value);
    return value.array;
  }
  // Whole steps of a range, or of time the differences from sample to sample.
  function counted(value) {
    const steps = new (value.wide ? Int32Array : Int16Array)(bytes(value.steps)), found = new Float64Array(steps.length);
    let sum = 0;
    steps.forEach((v, k) => {
      sum = value.wide ? sum + v : v;
      found[k] = !value.wide && v === -32768 ? NaN : value.low + value.step * sum;
    });
    return found;
  }

  // The smallest and the largest value of every stretch of the part that is shown.
  function thinned(x, y, from, to, most) {
    let a = 0, b = x.length;
    while (a < b && x[a] < from) a++;
    while (b > a && x[b - 1] > to) b--;
    a = Math.max(0, a - 2);
    b = Math.min(x.length, b + 2);
    const each = Math.ceil((b - a) / most);
    if (each <= 2) return { x: x.slice(a, b), y: y.slice(a, b) };
    const n = Math.ceil((b - a) / each), tx = new Float64Array(2 * n), ty = new Float64Array(2 * n);
    for (let k = 0; k < n; k++) {
      let low = NaN, high = NaN;
      for (let i = a + k * each; i < Math.min(a + (k + 1) * each, b); i++) {
        if (!(low <= y[i])) low = Number.isNaN(y[i]) ? low : y[i];
        if (!(high >= y[i])) high = Number.isNaN(y[i]) ? high : y[i];
      }
      tx[2 * k] = tx[2 * k + 1] = x[a + k * each];
      ty[2 * k] = low;
      ty[2 * k + 1] = high;
    }
    return { x: tx, y: ty };
  }

  function painted(value) {
    if (Array.isArray(value)) return value.map(painted);
    if (value && typeof value === "object" && !value.bdata && !value.steps && !ArrayBuffer.isView(value)) {
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, painted(v)]));
    }
    return typeof value === "string" && value[0] === "@" && value !== "@time" ? payload.themes[theme()][value] : value;
  }

  const from = c => c.window ? c.window[0] : -Infinity, to = c => c.window ? c.window[1] : Infinity;
  function traces(chart) {
    return chart.traces.map(trace => {
      const made = painted(trace), x = numbers(trace.x), y = numbers(trace.y);
      if (trace.meta === "signal") return { ...made, ...thinned(x, y, from(chart), to(chart), payload.shown * 2) };
      if (trace.meta === "names") {  // names only while there is room for them
        const inside = x.filter(v => v >= from(chart) && v <= to(chart)).length;
        return { ...made, visible: true, mode: inside <= payload.room ? "text" : "markers", marker: { size: 3, color: payload.themes[theme()]["@muted"] } };
      }
      return { ...made, x, y };
    });
  }

  const NARROW = 560;  // px, below which two panels stand one under the other
  function stack(layout) {
    [layout.xaxis, layout.xaxis2].forEach(a => { a.domain = [0, 1]; });
    layout.yaxis.domain = [0.6, 1];
    layout.yaxis2.domain = [0, 0.4];
    layout.yaxis2.title = layout.yaxis2.title.text ? layout.yaxis2.title : layout.yaxis.title;
    layout.height = 640;
  }

  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  function draw(chart) {
    const place = document.getElementById(chart.id);
    if (place.offsetParent === null) return;
    const layout = { ...painted(payload.layout), ...painted(chart.layout) };
    if (layout.meta === "pair" && place.clientWidth < NARROW) stack(layout);
    if (chart.window) layout.xaxis = { ...layout.xaxis, range: chart.window, autorange: false };
    Plotly.react(place, traces(chart), layout, config);
    if (!chart.drawn && chart.traces.some(t => t.meta === "signal")) {
      place.on("plotly_relayout", change => {
        const asked = change["xaxis.autorange"] ? null
          : change["xaxis.range"] || ("xaxis.range[0]" in change ? [change["xaxis.range[0]"], change["xaxis.range[1]"]] : undefined);
        if (asked === undefined) return;
        chart.window = asked;
        draw(chart);
      });
    }
    chart.drawn = true;
  }
  const drawAll = () => payload.charts.forEach(draw);
  const below = chart => document.getElementById(chart.id).getBoundingClientRect().top - window.innerHeight;
  // What is on the screen at once, the rest while the reader reads: each chart leaves the page time to answer.
  async function open() {
    const near = payload.charts.filter(c => below(c) < 0);
    near.forEach(draw);
    root.dataset.opened = "true";
    for (const chart of payload.charts.filter(c => !near.includes(c))) {
      await new Promise(next => setTimeout(next));
      if (!chart.drawn) draw(chart);
    }
    root.dataset.ready = "true";
  }

  function csv(chart) {
    const columns = [];
    for (const trace of chart.traces) {
      for (const axis of ["x", "y", "z", "text"]) {
        if (Array.isArray(trace[axis]) || (trace[axis] && (trace[axis].bdata || trace[axis].steps)) || trace[axis] === "@time") {
          columns.push([`${trace.name}: ${axis}`, ...Array.from(numbers(trace[axis])).flat()]);
        }
      }
    }
    const cell = v => v === null || v === undefined || Number.isNaN(v) ? "" : /[",\n]/.test(v) ? `"${String(v).replaceAll('"', '""')}"` : String(v);
    const rows = Math.max(...columns.map(c => c.length));
    return Array.from({ length: rows }, (_, k) => columns.map(c => cell(c[k])).join(",")).join("\n") + "\n";
  }

  for (const group of document.querySelectorAll(".chooser")) {
    const select = group.querySelector("select");
    const show = () => {
      group.querySelectorAll("figure").forEach(f => { f.hidden = f.dataset.chart !== select.value; });
      payload.charts.filter(c => c.id === select.value).forEach(draw);
    };
    select.addEventListener("change", show);
    group.querySelectorAll("figure").forEach(f => { f.hidden = f.dataset.chart !== select.value; });
  }
  for (const button of document.querySelectorAll(".csv")) {
    button.addEventListener("click", () => {
      const chart = payload.charts.find(c => c.id === button.closest("figure").dataset.chart);
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([csv(chart)], { type: "text/csv" }));
      link.download = `${chart.id}.csv`;
      link.click();
      URL.revokeObjectURL(link.href);
    });
  }
  document.getElementById("theme").addEventListener("click", () => {
    root.dataset.theme = theme() === "dark" ? "light" : "dark";
    drawAll();
  });
  dark.addEventListener("change", () => { root.dataset.theme = dark.matches ? "dark" : "light"; drawAll(); });
  // Paper is white.
  let shown = null;
  window.addEventListener("beforeprint", () => { shown = theme(); if (shown === "dark") { root.dataset.theme = "light"; drawAll(); } });
  window.addEventListener("afterprint", () => { if (shown === "dark") { root.dataset.theme = shown; drawAll(); } });
  await open();
})();
