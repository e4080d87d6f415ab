// Learning curves that answer: values under the pointer, single seeds with their trials, zoom, a logarithmic axis,
// and a choice of lines. The drawing stays in the page, for print and for those without scripts, and nothing is
// loaded. Needs uPlot.
"use strict";
(() => {
  const theme = matchMedia("(prefers-color-scheme: dark)");
  const variable = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const short = value => value == null ? "" : Math.abs(value) >= 1e6 ? +(value / 1e6).toPrecision(6) + "M"
    : Math.abs(value) >= 1e4 ? +(value / 1e3).toPrecision(6) + "k"
    : value && Math.abs(value) < 1e-3 ? value.toExponential() : String(+value.toPrecision(6));
  const four = value => value == null ? "–" : short(+value.toPrecision(4));

  function make(tag, className, text, parent) {
    const element = document.createElement(tag);
    element.className = className;
    element.textContent = text;
    parent?.append(element);
    return element;
  }

  function button(text, parent, pressed) {
    const element = make("button", "", text, parent);
    element.type = "button";
    element.addEventListener("click", () => pressed(element));
    return element;
  }

  function check(text, on, parent, changed) {
    const label = make("label", "", "", parent), box = make("input", "", "", label);
    box.type = "checkbox";
    box.checked = on;
    box.addEventListener("change", () => changed(box.checked));
    make("span", "", text, label);
    return label;
  }

  // The columns of a panel, the first at the bottom: single runs, the ends of bands, lines.
  function columns(panel) {
    const series = [...panel.series].sort((a, b) => !!b.other - !!a.other), all = [];
    const add = (role, one, x, y, run) => all.push({ role, one, x, y, run });
    series.filter(one => !one.other).forEach(one => one.runs?.forEach(run => add("run", one, run.x ?? one.x, run.y, run)));
    series.filter(one => one.low && !one.other).forEach(one => ["high", "low"].forEach(end => add(end, one, one.x, one[end])));
    const ends = all.concat(series.filter(one => one.x)).flatMap(one => [one.x[0], one.x[one.x.length - 1]]);
    const across = [Math.min(...ends), Math.max(...ends)];
    series.forEach(one => "level" in one ? add("line", one, across, [one.level, one.level])
      : add("line", one, one.x, one.y));
    return all;
  }

  // The place of the value nearest to a place; lines have steps of their own.
  function nearest(values, at) {
    for (let far = 0; far < values.length; far++) {
      if (values[at - far] != null) return at - far;
      if (values[at + far] != null) return at + far;
    }
    return -1;
  }

  function figure(host, data) {
    const drawing = host.querySelector("svg"), box = make("div", "plot", ""), bar = make("div", "bar", "", box);
    const grid = make("div", "panels", "", box), legend = make("div", "legend", "", box);
    const hint = matchMedia("(pointer: coarse)").matches
      ? "Touch a plot for values; stretch it with two fingers." : "Move over a plot for values; drag to zoom, double-click for all.";
    const trace = make("p", "trace", hint, box);
    const series = data.panels.flatMap(panel => panel.series), off = new Set(), values = new Map();
    const positive = series.every(one => [].concat(one.y ?? one.level).some(value => value > 0));
    let runs = series.some(one => one.drawn), log = data.panels.some(panel => panel.log), words = "", plots = [];
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", drawing.getAttribute("aria-label"));
    grid.style.setProperty("--columns", data.columns);

    // All grey lines are one entry of the legend.
    const entry = one => one.other ? null : one.label;
    const isShown = ({ role, one }) => !off.has(entry(one)) && one.label.toLowerCase().includes(words)
      && (role !== "run" || runs);
    const show = () => plots.forEach(({ plot, all }) => plot.batch(() => all.forEach((column, index) =>
      plot.setSeries(index + 1, { show: isShown(column) }))));

    // What stands under the pointer: the values of all lines, and which line is nearest.
    function tell(plot, all, panel) {
      const { idx, top } = plot.cursor;
      values.forEach(output => output.textContent = "");
      if (idx == null || top < 0) return plot.setSeries(null, { focus: true });
      const found = all.map((column, index) => ({ column, index, at: nearest(plot.data[index + 1], idx) }))
        .filter(({ column, at }) => at >= 0 && isShown(column))
        .map(it => ({ ...it, value: plot.data[it.index + 1][it.at], ...it.column }));
      found.filter(it => it.role === "line").forEach(({ one, value }) => {
        const ends = found.filter(it => it.one === one && ["low", "high"].includes(it.role)).map(it => it.value);
        const band = ends.length ? ` [${ends.sort((a, b) => a - b).map(four).join(", ")}]` : "";
        if (!one.other) values.get(one.label).textContent = four(value) + band;
      });
      const far = ({ value }) => Math.abs(plot.valToPos(value, "y") - top);
      const lines = found.filter(it => ["line", "run"].includes(it.role)).sort((a, b) => far(a) - far(b));
      if (!lines.length) return;
      const { one, run, value, at, index } = lines[0], place = panel.title ? `${panel.title}, ` : "";
      const who = one.label + (run ? `, ${run.name}` : "");
      trace.textContent = `${place}${who}: ${four(value)} at ${short(plot.data[0][at])} ${panel.x}`;
      if (run?.trial) trace.append(", trial ", make("code", "", run.trial));
      plot.setSeries(index + 1, { focus: true });
    }

    // One finger points, and still moves the page up and down; two keep the steps under them while they move.
    function touched(plot) {
      const over = plot.over, steps = plot.data[0];
      let held = null;
      const places = event => {
        const corner = over.getBoundingClientRect();
        return [...event.touches].slice(0, 2).map(it => [it.clientX - corner.left, it.clientY - corner.top]);
      };
      const begin = event => {
        const at = places(event);
        held = at.length === 2 ? at.map(([left]) => plot.posToVal(left, "x")) : null;
        if (at.length === 1) plot.setCursor({ left: at[0][0], top: at[0][1] });
      };
      const move = event => {
        const at = places(event);
        if (at.length === 1 && !held) return plot.setCursor({ left: at[0][0], top: at[0][1] });
        if (at.length < 2 || !held) return;
        event.preventDefault();
        const perPixel = (held[1] - held[0]) / (at[1][0] - at[0][0]), min = held[0] - at[0][0] * perPixel;
        if (perPixel > 0 && isFinite(perPixel)) plot.setScale("x", { min: Math.max(min, steps[0]),
          max: Math.min(min + over.clientWidth * perPixel, steps[steps.length - 1]) });
      };
      over.style.touchAction = "pan-y";
      over.addEventListener("touchstart", begin, { passive: true });
      over.addEventListener("touchmove", move, { passive: false });
      over.addEventListener("touchend", begin, { passive: true });
    }

    function draw(panel, cell) {
      const all = columns(panel), shade = theme.matches ? "dark" : "light", ink = variable("--ink");
      const table = uPlot.join(all.map(({ x, y }) => [x, log ? y.map(value => value > 0 ? value : null) : y]));
      const opacity = { light: "2e", dark: "4c" }[shade], bands = [];
      const config = column => {
        const [line, thin] = column.one[shade], isRun = column.role === "run";
        const isDot = (isRun || column.role === "line") && column.y.length === 1;
        const points = isDot ? { show: true, size: 6, stroke: line, fill: line } : { show: false };
        const common = { show: isShown(column), spanGaps: true, points };
        if (!isRun && column.role !== "line") return { ...common, stroke: "transparent", width: 0 };
        const dash = isRun ? [] : column.one.dash.map(length => length * 4 / 3);
        return { ...common, stroke: isRun ? thin : line, width: isRun || column.one.other ? 1 : 1.8, dash };
      };
      all.forEach((column, index) => column.role === "high" && bands.push({ series: [index + 1, index + 2],
        fill: column.one[shade][0] + opacity }));
      const axis = (label, more) => ({ label, stroke: ink, font: "12px system-ui, sans-serif", labelSize: 22,
        labelFont: "12px system-ui, sans-serif", labelGap: 4, values: (_, splits) => splits.map(short),
        grid: { stroke: variable("--line"), width: 1 }, ticks: { stroke: ink, width: 1, size: 4 },
        border: { show: true, stroke: ink, width: 1 }, ...more });
      const width = cell.clientWidth;
      const plot = new uPlot({
        width, height: Math.round(Math.max(200, Math.min(0.62 * width, 340))), padding: [8, 24, 0, 0],
        scales: { x: { time: false }, y: { distr: log ? 3 : 1 } },
        axes: [axis(panel.x, { size: 30 }), axis(panel.y,
          { size: (_, texts) => 14 + 7 * Math.max(2, ...(texts ?? []).map(text => String(text).length)) })],
        series: [{}, ...all.map(config)], bands, legend: { show: false }, focus: { alpha: 0.35 },
        cursor: { drag: { x: true, y: true, uni: 40 }, points: { show: false } },
        hooks: { setCursor: [plot => tell(plot, all, panel)] },
      }, table, cell);
      touched(plot);
      return { plot, all, cell };
    }

    function build() {
      plots.forEach(({ plot }) => plot.destroy());
      grid.replaceChildren();
      plots = data.panels.map(panel => {
        const cell = make("div", "panel", "", grid);
        if (panel.title) make("p", "title", panel.title, cell);
        return { panel, cell };
      }).map(({ panel, cell }) => draw(panel, cell));
      legend.querySelectorAll("i").forEach((mark, index) =>
        mark.style.borderColor = names[index][theme.matches ? "dark" : "light"][0]);
    }

    const distinct = series.filter((one, at) => series.findIndex(other => other.label === one.label) === at);
    const others = distinct.filter(one => one.other), names = distinct.filter(one => !one.other).concat(others.slice(0, 1));
    button("as drawn", bar, it => it.textContent = host.classList.toggle("drawn") ? "interactive" : "as drawn");
    if (series.some(one => one.runs?.length))
      check("single runs", runs, bar, on => { runs = on; show(); });
    if (positive) check("logarithmic", log, bar, on => { log = on; build(); });
    button("whole range", bar, () => plots.forEach(({ plot }) => plot.setData(plot.data)));
    if (distinct.length > 5) {
      const filter = make("input", "", "", bar);
      filter.type = "search";
      filter.placeholder = "only with these words";
      filter.setAttribute("aria-label", filter.placeholder);
      filter.addEventListener("input", () => { words = filter.value.trim().toLowerCase(); show(); });
    }
    names.forEach(one => {
      const text = one.other ? `${others.length} others` : one.label || "line";
      const label = check(text, true, legend, on => { on ? off.delete(entry(one)) : off.add(entry(one)); show(); });
      label.title = one.other ? others.map(it => it.legend).join("\n") : one.legend;
      const mark = make("i", one.dash.length ? "dashed" : "", "");
      label.insertBefore(mark, label.lastChild);
      values.set(one.label, make("output", "", "", label));
    });
    drawing.after(box);
    host.classList.add("plotted");
    build();
    theme.addEventListener("change", build);
    new ResizeObserver(() => plots.forEach(({ plot, cell }) => cell.clientWidth > 0 && cell.clientWidth !== plot.width
      && plot.setSize({ width: cell.clientWidth, height: plot.height }))).observe(grid);
  }

  document.querySelectorAll("figure > script.lines").forEach(source =>
    figure(source.parentElement, JSON.parse(source.textContent)));

  // Browsers whose style sheets cannot open what is folded in print.
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll("details:not([open])")];
    opened.forEach(one => one.open = true);
  });
  addEventListener("afterprint", () => opened.forEach(one => one.open = false));
})();
