// Charts of each compass, drawn when its part of the page is unfolded: uPlot draws those with axes, `drawSphere` the sphere.
// Each `.charts` has a script with the numbers of samples.rs, and a `.chart` for each figure. Colours are those of the style.
(() => {
  "use strict";
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const FONT = "12px system-ui, sans-serif";
  const AXES = ["x", "y", "z"];
  // Size of a chart on paper, CSS pixels: the style shrinks it to a third of a page of A4.
  const PAPER = [360, 210];
  const shown = [];

  // Numbers of the samples; columns without any are undefined.
  function loaded(box) {
    const data = JSON.parse(box.querySelector("script").textContent);
    const scaled = (column) => column.map((number) => (number === null ? null : number / 100));
    data.t = scaled(data.t);
    for (const name of Object.keys(data.columns)) data[name] = scaled(data.columns[name]);
    for (const curve of [...data.curves.before, ...data.curves.after]) curve.errors = scaled(curve.errors);
    return data;
  }

  const is = (data, i, bit) => (Number(data.kinds[i]) & bit) !== 0;
  const vector = (data, name, i) => AXES.map((axis) => data[`${name}_${axis}`]?.[i] ?? null);
  const strengths = (data, name) =>
    data[`${name}_x`] && data.t.map((_, i) => (data[`${name}_x`][i] === null ? null : Math.hypot(...vector(data, name, i))));
  const fixed = (digits) => (u, value) => (value === null || value === undefined ? "–" : value.toFixed(digits));

  // The Earth's field in the axes of the aircraft.
  function expected(data) {
    const sincos = (deg) => [Math.sin((deg * Math.PI) / 180), Math.cos((deg * Math.PI) / 180)];
    const [total, inclination] = data.earth;
    const [sinI, cosI] = sincos(inclination);
    const none = [null, null, null];
    const rows = data.t.map((_, i) => {
      if (!data.heading || data.heading[i] === null || data.roll?.[i] == null || data.pitch?.[i] == null) return none;
      const [sinH, cosH] = sincos(data.heading[i] + data.offset);
      const [sinR, cosR] = sincos(data.roll[i]);
      const [sinP, cosP] = sincos(data.pitch[i]);
      const [ahead, right, down] = [cosI * cosH, -cosI * sinH, sinI];
      const [x, below] = [ahead * cosP - down * sinP, ahead * sinP + down * cosP];
      return [x, right * cosR + below * sinR, below * cosR - right * sinR].map((part) => part * total);
    });
    return AXES.map((_, axis) => rows.map((row) => row[axis]));
  }

  const line = (label, name, more = {}) => ({ label, stroke: () => colour(name), width: 1.4, value: fixed(2), points: { show: false }, ...more });
  const points = (label, name, more = {}) =>
    line(label, name, { paths: () => null, points: { show: true, size: 3, width: 0, fill: () => colour(name), stroke: () => colour(name) }, ...more });

  function axis(label, more = {}) {
    return {
      label, labelFont: FONT, font: FONT, labelSize: 18, size: 46, stroke: () => colour("--ink"),
      grid: { stroke: () => colour("--rule"), width: 1 }, ticks: { stroke: () => colour("--rule"), width: 1 }, ...more,
    };
  }

  // Marks of changes, and times without a heading or not used.
  const marked = (data) => ({
    hooks: {
      drawClear: [(u) => {
        const { left, top, width, height } = u.bbox;
        const edge = (s) => Math.min(Math.max(u.valToPos(s, "x", true), left), left + width);
        for (const [name, opacity, belongs] of [["--soft", 0.14, (i) => !is(data, i, 1)], ["--miss", 0.28, (i) => is(data, i, 1) && is(data, i, 4)]]) {
          u.ctx.save();
          u.ctx.globalAlpha = opacity;
          u.ctx.fillStyle = colour(name);
          for (let from = 0; from < data.t.length; from++) {
            if (!belongs(from)) continue;
            let to = from;
            while (to + 1 < data.t.length && belongs(to + 1)) to++;
            const [a, b] = [edge(data.t[from]), edge(data.t[Math.min(to + 1, data.t.length - 1)])];
            u.ctx.fillRect(a, top, b - a, height);
            from = to;
          }
          u.ctx.restore();
        }
      }],
      draw: [(u) => {
        const { left, top, width, height } = u.bbox;
        u.ctx.save();
        u.ctx.strokeStyle = u.ctx.fillStyle = colour("--ink");
        u.ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
        u.ctx.setLineDash([5 * devicePixelRatio, 3 * devicePixelRatio]);
        u.ctx.textAlign = "left";
        // Right edges of the labels in each line: a label goes to the first line with room.
        const edges = [];
        data.marks.forEach(({ at, name }) => {
          const x = u.valToPos(at, "x", true);
          if (x < left || x > left + width) return;
          u.ctx.beginPath();
          u.ctx.moveTo(x, top);
          u.ctx.lineTo(x, top + height);
          u.ctx.stroke();
          const size = u.ctx.measureText(name).width;
          const space = 4 * devicePixelRatio;
          const from = x + space + size < left + width ? x + space : Math.max(left, x - space - size);
          const free = edges.findIndex((edge) => edge < from);
          const row = free < 0 ? edges.length : free;
          edges[row] = from + size + 6 * devicePixelRatio;
          u.ctx.fillText(name, from, top + (13 + 14 * row) * devicePixelRatio);
        });
        u.ctx.restore();
      }],
    },
  });

  const overTime = { axes: [axis("time of the log, s", { size: 34 })], at: "s", isTime: true };

  const CHARTS = {
    strength(data) {
      const [before, corrected, logged] = ["raw", "corrected", "logged"].map((name) => strengths(data, name));
      const series = [[line("uncorrected", "--c0", { dash: [2, 3] }), before]];
      if (logged) series.push([line("as logged", "--c1"), logged]);
      if (corrected) series.push([line("corrected", "--c3", { width: 2 }), corrected]);
      if (data.earth) series.push([line("expected", "--c0", { dash: [8, 4] }), data.t.map(() => data.earth[0])]);
      if (data.current) series.push([line("current, A", "--c2", { scale: "A" }), data.current]);
      const right = data.current ? [axis("A", { scale: "A", side: 1, grid: { show: false } })] : [];
      return { ...overTime, ...marked(data), x: data.t, series, axes: [...overTime.axes, axis("uT"), ...right] };
    },
    errors(data) {
      const series = [];
      if (data.before) series.push([line(data.before_name, "--c1"), data.before]);
      if (data.parameters) series.push([line("parameters", "--c2"), data.parameters]);
      if (data.module) series.push([line("module", "--c3"), data.module]);
      const bands = [];
      if (data.sigma && data.module) {
        const side = (sign) => data.sigma.map((sigma, i) => (sigma === null || data.module[i] === null ? null : sign * sigma));
        bands.push({ series: [series.length + 1, series.length + 2], fill: () => `${colour("--band")}33` });
        for (const [label, sign] of [["+sigma", 1], ["-sigma", -1]]) series.push([line(label, "--band", { width: 0 }), side(sign)]);
      }
      return { ...overTime, ...marked(data), x: data.t, series, bands, axes: [...overTime.axes, axis(`${data.error}, deg`)] };
    },
    by_heading(data) {
      const order = data.t.map((_, i) => i).filter((i) => is(data, i, 1) && data.heading?.[i] != null).sort((a, b) => data.heading[a] - data.heading[b]);
      const cloud = [order.map((i) => data.heading[i])];
      const series = [];
      for (const [name, label, tone] of [["before", data.before_name, "--c1"], ["parameters", "parameters", "--c2"], ["module", "module", "--c3"]]) {
        if (!data[name]) continue;
        cloud.push(order.map((i) => data[name][i]));
        series.push(points(label, tone));
      }
      const tables = cloud.length > 1 ? [cloud] : [];
      const tones = ["--c0", "--c4", "--c1"];
      const mean = (when, curve, tone, dash) => {
        const step = 360 / curve.errors.length;
        tables.push([[...curve.errors, curve.errors[0]].map((_, i) => i * step), [...curve.errors, curve.errors[0]]]);
        series.push(line(`${when}: ${curve.name}`, tone, { spanGaps: true, width: 2, dash }));
      };
      data.curves.before.forEach((curve, i) => mean("before", curve, tones[i % 3], [8, 4]));
      data.curves.after.forEach((curve, i) => mean("after", curve, tones[i % 3]));
      const [x, ...columns] = uPlot.join(tables);
      return {
        x, series: series.map((item, i) => [item, columns[i]]),
        at: "heading", scales: { x: { time: false, range: [0, 360] } },
        axes: [axis("heading, deg", { size: 34, splits: () => [0, 60, 120, 180, 240, 300, 360] }), axis(`${data.error}, deg`)],
      };
    },
    axes(data) {
      const tones = ["--c1", "--c2", "--c3"];
      const series = AXES.map((name, i) => [line(name, tones[i]), data[`corrected_${name}`]]);
      if (data.earth) expected(data).forEach((column, i) => series.push([line(`${AXES[i]} expected`, tones[i], { dash: [4, 3], width: 2 }), column]));
      return { ...overTime, ...marked(data), x: data.t, series, axes: [...overTime.axes, axis("uT")] };
    },
    current(data) {
      const order = data.t.map((_, i) => i).filter((i) => is(data, i, 1) && data.current[i] !== null).sort((a, b) => data.current[a] - data.current[b]);
      const should = data.earth ? expected(data) : AXES.map(() => data.t.map(() => 0));
      const tones = ["--c1", "--c2", "--c3"];
      const series = [];
      for (const [name, label, isShown] of [[data.logged_x ? "logged" : "raw", data.logged_x ? "as logged" : "uncorrected", true], ["corrected", "corrected", false]]) {
        AXES.forEach((axisName, k) => {
          const column = data[`${name}_${axisName}`];
          const differences = order.map((i) => (column[i] === null || should[k][i] === null ? null : column[i] - should[k][i]));
          series.push([points(`${axisName} ${label}`, tones[k], { show: isShown }), differences]);
        });
      }
      return { at: "A", x: order.map((i) => data.current[i]), series, axes: [axis("current, A", { size: 34 }), axis("difference, uT")] };
    },
  };

  // Cells of 30 by 30 deg of directions without a sample; with a known inclination those that level flight and turns reach.
  const REACH_DEG = 45;
  function missingCells(directions, inclination) {
    const seen = new Set(directions.map(([x, y, z]) => {
      const down = Math.asin(Math.max(-1, Math.min(1, z)));
      return `${Math.floor(((Math.atan2(y, x) / Math.PI) * 6 + 12) % 12)} ${Math.min(5, Math.floor((down / Math.PI + 0.5) * 6))}`;
    }));
    const cells = [];
    const isReached = (b) => inclination === undefined || Math.abs(30 * b - 75 - inclination) < REACH_DEG;
    for (let a = 0; a < 12; a++) for (let b = 0; b < 6; b++) if (isReached(b) && !seen.has(`${a} ${b}`)) cells.push([a, b]);
    return cells;
  }

  function onSphere(azimuth, elevation) {
    const [a, e] = [(azimuth * Math.PI) / 6, ((elevation - 3) * Math.PI) / 6];
    return [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  }

  function drawSphere(holder, data) {
    const canvas = holder.appendChild(document.createElement("canvas"));
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Directions of the field: turn with the arrow keys");
    const counted = data.t.map((_, i) => i).filter((i) => is(data, i, 1));
    const cloud = (name) => (data[`${name}_x`] ? counted.map((i) => vector(data, name, i)).filter((ut) => ut[0] !== null) : []);
    const [raw, corrected] = ["raw", "corrected"].map(cloud);
    const mean = (all) => all.reduce((sum, ut) => sum + Math.hypot(...ut), 0) / Math.max(1, all.length);
    const total = data.earth?.[0] ?? mean(raw);
    const directions = (corrected.length ? corrected : raw).map((ut) => ut.map((part) => part / Math.hypot(...ut)));
    const cells = missingCells(directions, data.earth?.[1]);
    const view = { turn: -0.6, tilt: 0.4 };
    function draw(width) {
      const size = Math.min(width, 420);
      canvas.style.width = canvas.style.height = `${size}px`;
      canvas.width = canvas.height = size * devicePixelRatio;
      const ctx = canvas.getContext("2d");
      ctx.scale((size / 2) * devicePixelRatio, (size / 2) * devicePixelRatio);
      ctx.translate(1, 1);
      const far = Math.max(1.05, ...raw.map((ut) => Math.hypot(...ut) / total));
      const [sinT, cosT, sinE, cosE] = [Math.sin(view.turn), Math.cos(view.turn), Math.sin(view.tilt), Math.cos(view.tilt)];
      // Nose to the right and up the page's depth, down is down.
      const seen = ([x, y, z]) => {
        const [across, deep] = [x * cosT - y * sinT, x * sinT + y * cosT];
        return [(0.92 * across) / far, (0.92 * (z * cosE + deep * sinE)) / far, deep * cosE - z * sinE];
      };
      const path = (corners) => corners.forEach((corner, i) => (i ? ctx.lineTo(corner[0], corner[1]) : ctx.moveTo(corner[0], corner[1])));
      ctx.lineWidth = 1 / size;
      ctx.strokeStyle = colour("--rule");
      for (let a = 0; a < 12; a++) (ctx.beginPath(), path([...Array(25).keys()].map((i) => seen(onSphere(a, i / 4)))), ctx.stroke());
      for (let b = 1; b < 6; b++) (ctx.beginPath(), path([...Array(49).keys()].map((i) => seen(onSphere(i / 4, b)))), ctx.stroke());
      ctx.fillStyle = colour("--miss");
      for (const [a, b] of cells) {
        const edge = [0, 0.25, 0.5, 0.75, 1];
        const corners = [...edge.map((e) => [a + e, b]), ...edge.map((e) => [a + 1, b + e]), ...edge.map((e) => [a + 1 - e, b + 1]), ...edge.map((e) => [a, b + 1 - e])];
        ctx.globalAlpha = seen(onSphere(a + 0.5, b + 0.5))[2] < 0 ? 0.3 : 0.08;
        ctx.beginPath();
        path(corners.map(([x, y]) => seen(onSphere(x, y))));
        ctx.fill();
      }
      for (const [all, tone, half] of [[raw, "--c1", 0.005], [corrected, "--c3", 0.007]]) {
        ctx.fillStyle = colour(tone);
        for (const ut of all) {
          const [x, y, deep] = seen(ut.map((part) => part / total));
          ctx.globalAlpha = deep < 0 ? 0.9 : 0.3;
          ctx.fillRect(x - half, y - half, 2 * half, 2 * half);
        }
      }
      ctx.globalAlpha = 1;
      ctx.fillStyle = colour("--ink");
      ctx.font = `bold ${28 / size}px system-ui, sans-serif`;
      ctx.textAlign = "center";
      ctx.strokeStyle = colour("--paper");
      ctx.lineWidth = 8 / size;
      for (const [name, direction] of [["nose", [1.04, 0, 0]], ["right wing", [0, 1.04, 0]], ["down", [0, 0, 1.04]]]) {
        const at = seen(direction).slice(0, 2);
        ctx.strokeText(name, ...at);
        ctx.fillText(name, ...at);
      }
    }
    const legend = holder.appendChild(document.createElement("p"));
    legend.className = "key";
    for (const [name, tone, shownItems] of [["uncorrected", "c1", raw], ["corrected", "c3", corrected], ["not flown", "miss", cells]]) {
      if (!shownItems.length) continue;
      const item = legend.appendChild(document.createElement("span"));
      item.className = `key-${tone}`;
      item.textContent = name;
    }
    let width = holder.clientWidth;
    const redraw = () => draw(width);
    let from = null;
    canvas.addEventListener("pointerdown", (event) => ((from = [event.clientX, event.clientY]), canvas.setPointerCapture(event.pointerId)));
    canvas.addEventListener("pointermove", (event) => {
      if (from === null) return;
      view.turn += (event.clientX - from[0]) / 150;
      view.tilt += (event.clientY - from[1]) / 150;
      from = [event.clientX, event.clientY];
      redraw();
    });
    for (const type of ["pointerup", "pointercancel"]) canvas.addEventListener(type, () => (from = null));
    canvas.addEventListener("keydown", (event) => {
      const [turn, tilt] = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] }[event.key] ?? [0, 0];
      if (turn === 0 && tilt === 0) return;
      event.preventDefault();
      view.turn += turn;
      view.tilt += tilt;
      redraw();
    });
    return { redraw, resize: (to, high = to) => ((width = Math.min(to, 1.2 * high)), redraw()) };
  }

  const height = (width) => Math.round(Math.min(300, Math.max(190, 0.55 * width)));

  function drawPlot(holder, chart, group) {
    const width = holder.clientWidth;
    const plot = new uPlot({
      width, height: height(width),
      series: [{ label: chart.at, value: fixed(1) }, ...chart.series.map(([series]) => series)],
      axes: chart.axes,
      bands: chart.bands,
      legend: { markers: { dash: (u, i) => (u.series[i].dash ? "dashed" : "solid") } },
      scales: chart.scales ?? { x: { time: false } },
      cursor: { drag: { x: true, y: false }, ...(chart.isTime ? { sync: { key: group.key } } : {}) },
      hooks: { ...chart.hooks, ...(chart.isTime ? { setScale: [(u, scale) => scale === "x" && group.follow(u)] } : {}) },
    }, [chart.x, ...chart.series.map(([, column]) => column)], holder);
    if (chart.isTime) group.plots.push(plot);
    return { redraw: () => plot.redraw(false), resize: (to, high = height(to)) => plot.setSize({ width: to, height: high }) };
  }

  // Charts over time show the same range: dragged in one of them, or entered.
  function timeRange(box, data) {
    const [first, last] = [data.t[0], data.t[data.t.length - 1]];
    const group = { key: box.parentElement.dataset.compass, plots: [], isBusy: false };
    const bar = document.createElement("p");
    bar.className = "range";
    const field = (text) => {
      const label = bar.appendChild(document.createElement("label"));
      label.textContent = text;
      const input = label.appendChild(document.createElement("input"));
      Object.assign(input, { type: "number", step: "any", min: first, max: last });
      input.addEventListener("change", () => group.show(from.valueAsNumber, to.valueAsNumber));
      return input;
    };
    const [from, to] = [field("Show from "), field("to ")];
    const whole = bar.appendChild(document.createElement("button"));
    Object.assign(whole, { type: "button", textContent: "Whole flight" });
    whole.addEventListener("click", () => group.show(first, last));
    // Only the page that judges logs can judge a part.
    const part = bar.appendChild(document.createElement("button"));
    Object.assign(part, { type: "button", textContent: "Judge this part", hidden: true });
    part.addEventListener("click", () => window.judgePart(from.valueAsNumber, to.valueAsNumber));
    group.show = (min, max) => max > min && group.plots[0]?.setScale("x", { min, max });
    group.follow = (plot) => {
      if (group.isBusy) return;
      group.isBusy = true;
      const { min, max } = plot.scales.x;
      for (const other of group.plots) if (other !== plot) other.setScale("x", { min, max });
      [from.value, to.value] = [min.toFixed(1), max.toFixed(1)];
      part.hidden = window.judgePart === undefined || max - min > last - first - 0.2;
      group.isBusy = false;
    };
    if (last > first) box.before(bar);
    return group;
  }

  function draw(box) {
    if (box.dataset.drawn) return;
    box.dataset.drawn = "yes";
    const data = loaded(box);
    const group = timeRange(box, data);
    for (const holder of box.querySelectorAll(".chart")) {
      const { chart: kind } = holder.dataset;
      const drawn = kind === "sphere" ? drawSphere(holder, data) : drawPlot(holder, CHARTS[kind](data), group);
      drawn.resize(holder.clientWidth);
      shown.push({ holder, ...drawn });
    }
  }

  function drawVisible() {
    for (const box of document.querySelectorAll(".charts")) if (box.clientWidth > 0) draw(box);
  }
  for (const part of document.querySelectorAll("details")) part.addEventListener("toggle", drawVisible);
  addEventListener("compasschosen", drawVisible);
  drawVisible();
  const each = (act) => shown.filter(({ holder }) => holder.isConnected).forEach(act);
  addEventListener("resize", () => each(({ holder, resize }) => holder.clientWidth > 0 && resize(holder.clientWidth)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => each(({ redraw }) => redraw()));
  // Folded parts are unfolded on paper, and folded again after it.
  let folded = [];
  addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll("details:not([open], .terminal, .menu)")];
    for (const part of folded) part.open = true;
    drawVisible();
    document.documentElement.classList.add("printing");
    each(({ resize }) => resize(...PAPER));
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    for (const part of folded) part.open = false;
    folded = [];
    each(({ holder, resize }) => holder.clientWidth > 0 && resize(holder.clientWidth));
  });
})();
