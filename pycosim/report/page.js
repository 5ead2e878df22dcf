"use strict";
// Unpacks the library and the charts once the answer is on the screen; draws a chart when it comes near the screen, and all
// of them for paper; in the reader's theme; never asks a server.
(async () => {
  const root = document.documentElement;
  const failed = document.getElementById("failed");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = () => root.dataset.theme, paper = () => "paper" in root.dataset, look = () => paper() ? "paper" : theme();
  root.dataset.theme = dark.matches ? "dark" : "light";

  function bytes(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text).buffer;
    // a plain loop: a call for each byte of the library takes half a second
    const found = atob(text), raw = new Uint8Array(found.length);
    for (let k = 0; k < found.length; k++) raw[k] = found.charCodeAt(k);
    return raw.buffer;
  }
  const unpack = id => new Response(new Blob([bytes(document.getElementById(id).textContent.trim())]).stream().pipeThrough(
    new DecompressionStream("gzip")), { headers: { "content-type": "text/javascript" } });
  function refuse(text) {
    failed.textContent = text;
    failed.hidden = false;
  }
  if (!("DecompressionStream" in window)) return refuse("The charts need a browser of 2023 or later; words and tables do not.");
  await new Promise(next => requestAnimationFrame(() => setTimeout(next)));  // the answer is painted before all else
  const unpacked = unpack("payload").json(), script = document.createElement("script");
  script.src = URL.createObjectURL(await unpack("plotly").blob());
  const loaded = await new Promise(then => {
    script.onload = () => then(true);
    script.onerror = () => then(false);
    document.head.append(script);
  });
  if (!loaded) return refuse("This browser refuses the charts' library; words and tables do not need it.");
  URL.revokeObjectURL(script.src);
  const payload = await unpacked;

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
    if (paper()) layout.width = place.clientWidth;
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
    chart.drawn = look();
  }

  // A page of twenty charts would be busy for seconds after it opened: those within a screen of what is shown are enough.
  const near = new Set();
  const far = chart => Math.abs(document.getElementById(chart.id).getBoundingClientRect().top);
  let drawing = false;
  async function drawNear() {  // each chart leaves the page time to answer
    if (drawing) return;
    drawing = true;
    for (;;) {
      const left = [...near].filter(c => c.drawn !== look()).sort((a, b) => far(a) - far(b));
      if (!left.length) break;
      draw(left[0]);
      await new Promise(next => setTimeout(next));
    }
    drawing = false;
    root.dataset.ready = "true";
  }
  const watched = new IntersectionObserver(changed => {
    for (const change of changed) {
      const chart = payload.charts.find(c => c.id === change.target.id);
      if (change.isIntersecting) near.add(chart); else near.delete(chart);
    }
    drawNear();
  }, { rootMargin: "100% 0px" });
  function paint(name) {
    root.dataset.theme = name;
    drawNear();
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
    };
    select.addEventListener("change", show);
    show();
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
  document.getElementById("theme").addEventListener("click", () => paint(theme() === "dark" ? "light" : "dark"));
  dark.addEventListener("change", () => paint(dark.matches ? "dark" : "light"));
  let shown = null;
  window.addEventListener("beforeprint", () => {  // paper is white, as wide as the style says, and shows every chart
    shown = theme();
    root.dataset.theme = "light";
    root.dataset.paper = "";
    payload.charts.forEach(draw);
  });
  window.addEventListener("afterprint", () => {
    delete root.dataset.paper;
    for (const chart of payload.charts.filter(c => c.drawn)) {  // to be drawn anew as wide as the screen
      Plotly.purge(chart.id);
      chart.drawn = null;
    }
    paint(shown);
  });
  payload.charts.forEach(c => watched.observe(document.getElementById(c.id)));
})();
