// Charts as SVG: rates with intervals, curves, points. Values on hover, by arrow keys and as a table.

/** Maps of values to [0, 1] and their round ticks. */
const SCALES = {
  linear(low, high, count = 6) {
    const rough = (high - low) / count,
      decade = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * decade).find((s) => s >= rough * 0.999);
    const ticks = [];
    for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++)
      ticks.push(+(k * step).toPrecision(12));
    return { at: (v) => (v - low) / (high - low), ticks };
  },
  log(low, high) {
    const ticks = [],
      many = Math.log10(high / low);
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++)
      for (const m of many < 1.3 ? [1, 2, 5] : many < 4 ? [1, 3] : [1]) ticks.push(m * 10 ** e);
    return {
      at: (v) => Math.log(v / low) / Math.log(high / low),
      ticks: ticks.filter((t) => t >= low * 0.999 && t <= high * 1.001),
    };
  },
  /** Square roots spread small values and keep zero. */
  sqrt(low, high) {
    const all = [0, 0.0001, 0.0005, 0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1];
    const at = (v) => Math.sqrt(Math.max(0, v) / high),
      ticks = [];
    for (const t of all)
      if (t <= high && (ticks.length === 0 || at(t) - at(ticks[ticks.length - 1]) > 0.085))
        ticks.push(t);
    return { at, ticks };
  },
};

/** Walks through points by pointer and by arrow keys. `points` have px, py and words. */
function inspect(svg, points, size) {
  const ring = el("circle", {
    r: 7,
    fill: "none",
    stroke: "var(--ink)",
    "stroke-width": 2,
    visibility: "hidden",
  });
  svg.append(ring);
  let at = -1;
  const show = (k) => {
    at = k;
    const p = points[k],
      box = svg.getBoundingClientRect(),
      zoom = box.width / size[0];
    ring.setAttribute("cx", p.px);
    ring.setAttribute("cy", p.py);
    ring.setAttribute("visibility", "visible");
    tip(p.words, scrollX + box.left + p.px * zoom, scrollY + box.top + p.py * zoom);
  };
  const hide = () => {
    ring.setAttribute("visibility", "hidden");
    tip(null);
  };
  svg.addEventListener("pointermove", (e) => {
    const box = svg.getBoundingClientRect(),
      zoom = size[0] / box.width;
    const x = (e.clientX - box.left) * zoom,
      y = (e.clientY - box.top) * zoom;
    let best = -1,
      least = 30 ** 2;
    points.forEach((p, k) => {
      const d = (p.px - x) ** 2 + (p.py - y) ** 2;
      if (d < least) {
        least = d;
        best = k;
      }
    });
    if (best < 0) hide();
    else show(best);
  });
  svg.addEventListener("pointerleave", hide);
  svg.addEventListener("blur", hide);
  svg.addEventListener("keydown", (e) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[e.key];
    if (e.key === "Escape") hide();
    if (!step || !points.length) return;
    e.preventDefault();
    show((at + step + points.length) % points.length);
  });
}

function legend(series) {
  return el(
    "div",
    { class: "legend" },
    ...series
      .filter((s) => s.name)
      .map((s) => el("span", {}, el("i", { style: `background:${s.color}` }), s.name)),
  );
}

/** Draws into `host` again whenever its width changes. */
function responsive(host, draw) {
  let width = 0;
  const redraw = () => {
    const now = Math.max(290, Math.min(760, Math.round(host.clientWidth)));
    if (now !== width) {
      width = now;
      host.replaceChildren(draw(width));
    }
  };
  new ResizeObserver(redraw).observe(host);
  queueMicrotask(redraw);
}

/** The values of a chart as a table. */
function values(heads, rows) {
  return el("details", {}, el("summary", { text: "Values" }), table(heads, rows));
}

/**
 * Curves over x. `spec`: title, note, x and y ({ label, scale, low, high, format }), series
 * ([{ name, color, points: [{ x, y, low, high }], line, marks }]), and marks ([{ x, label }]).
 * Returns the figure; its `mark(x, label)` moves the one mark.
 */
function curves(spec) {
  const host = el("div"),
    fx = spec.x.format || short,
    fy = spec.y.format || short,
    ty = spec.y.tick || fy;
  let mark = spec.mark || null;
  const words = (s, p) =>
    `${s.name}\n${spec.x.label}: ${fx(p.x)}\n${spec.y.label}: ${fy(p.y)}` +
    (p.low === undefined ? "" : ` [${fy(p.low)}, ${fy(p.high)}]`) +
    (p.note ? "\n" + p.note : "");
  const draw = (width) => {
    const height = Math.round(Math.max(230, width * 0.56)),
      left = 66,
      right = 14,
      top = 14,
      bottom = 46;
    const all = spec.series.flatMap((s) => s.points);
    const range = (axis, pick) => {
      const v = all.flatMap(pick).filter(Number.isFinite);
      let low = axis.low ?? Math.min(...v),
        high = axis.high ?? Math.max(...v);
      if (low === high) {
        low -= 0.5;
        high += 0.5;
      }
      return [low, high];
    };
    const X = SCALES[spec.x.scale || "linear"](...range(spec.x, (p) => [p.x]), width < 420 ? 4 : 6);
    const Y = SCALES[spec.y.scale || "linear"](
      ...range(spec.y, (p) => [p.y, p.low ?? p.y, p.high ?? p.y]),
    );
    const px = (v) => left + X.at(v) * (width - left - right),
      py = (v) => height - bottom - Y.at(v) * (height - top - bottom);
    const svg = el("svg", {
      viewBox: `0 0 ${width} ${height}`,
      role: "img",
      tabindex: 0,
      "aria-label": spec.title + ". Arrow keys go through the values.",
    });
    for (const t of Y.ticks)
      svg.append(
        el("line", { class: "grid", x1: left, x2: width - right, y1: py(t), y2: py(t) }),
        el("text", { x: left - 8, y: py(t) + 4, "text-anchor": "end", text: ty(t) }),
      );
    for (const t of X.ticks)
      svg.append(
        el("line", {
          class: "axis",
          x1: px(t),
          x2: px(t),
          y1: height - bottom,
          y2: height - bottom + 5,
        }),
        el("text", { x: px(t), y: height - bottom + 19, "text-anchor": "middle", text: fx(t) }),
      );
    svg.append(
      el("line", {
        class: "axis",
        x1: left,
        x2: width - right,
        y1: height - bottom,
        y2: height - bottom,
      }),
      el("text", {
        x: (left + width - right) / 2,
        y: height - 6,
        "text-anchor": "middle",
        text: spec.x.label,
      }),
      el("text", {
        transform: `translate(13 ${(top + height - bottom) / 2}) rotate(-90)`,
        "text-anchor": "middle",
        text: spec.y.label,
      }),
    );
    const seen = [];
    for (const s of spec.series) {
      const path = (points) =>
        points
          .map((p, i) => `${i ? "L" : "M"}${px(p[0]).toFixed(1)} ${py(p[1]).toFixed(1)}`)
          .join("");
      const banded = s.points.filter((p) => p.low !== undefined);
      if (banded.length > 1 && s.line !== false)
        svg.append(
          el("path", {
            d:
              path(
                banded.map((p) => [p.x, p.low]).concat(banded.map((p) => [p.x, p.high]).reverse()),
              ) + "Z",
            fill: s.color,
            opacity: 0.16,
          }),
        );
      else
        for (const p of banded)
          svg.append(
            el("line", {
              x1: px(p.x),
              x2: px(p.x),
              y1: py(p.low),
              y2: py(p.high),
              stroke: s.color,
              "stroke-width": 1.5,
            }),
          );
      if (s.line !== false)
        svg.append(
          el("path", {
            d: path(s.points.map((p) => [p.x, p.y])),
            fill: "none",
            stroke: s.color,
            "stroke-width": 2,
            "stroke-dasharray": s.dashed ? "5 4" : null,
          }),
        );
      for (const p of s.points) {
        if (s.marks !== false)
          svg.append(el("circle", { cx: px(p.x), cy: py(p.y), r: s.r || 3.2, fill: s.color }));
        if (s.silent !== true) seen.push({ px: px(p.x), py: py(p.y), words: words(s, p) });
      }
    }
    if (mark && X.at(mark.x) >= 0 && X.at(mark.x) <= 1) {
      const x = px(mark.x),
        end = X.at(mark.x) > 0.6;
      svg.append(
        el("line", {
          class: "mark",
          x1: x,
          x2: x,
          y1: top,
          y2: height - bottom,
          stroke: "var(--seam)",
          "stroke-width": 2,
          "stroke-dasharray": "6 4",
        }),
        el("text", {
          x: x + (end ? -6 : 6),
          y: height - bottom - 8,
          "text-anchor": end ? "end" : "start",
          style: "fill:var(--seam);font-weight:600",
          text: mark.label,
        }),
      );
    }
    inspect(svg, seen, [width, height]);
    return svg;
  };
  responsive(host, draw);
  const heads = [
    spec.x.label,
    ...spec.series.filter((s) => !s.silent).map((s) => s.name || spec.y.label),
  ];
  const xs = [
    ...new Set(spec.series.filter((s) => !s.silent).flatMap((s) => s.points.map((p) => p.x))),
  ].sort((a, b) => a - b);
  const rows = xs.map((x) => [
    fx(x),
    ...spec.series
      .filter((s) => !s.silent)
      .map((s) => {
        const p = s.points.find((q) => q.x === x);
        return !p
          ? "\u2013"
          : fy(p.y) + (p.low === undefined ? "" : ` [${fy(p.low)}, ${fy(p.high)}]`);
      }),
  ]);
  const figure = el(
    "figure",
    {},
    el("h3", { text: spec.title }),
    legend(spec.series),
    host,
    el("figcaption", { text: spec.note || "" }),
    values(heads, rows),
  );
  figure.mark = (x, label) => {
    mark = { x, label };
    host.replaceChildren(draw(Math.max(290, Math.min(760, Math.round(host.clientWidth)))));
  };
  return figure;
}

/**
 * Failure rates of several series in several groups: points with their intervals on an axis of square
 * roots. `groups`: [{ name, rates: [proportion or null] }] with one rate a series.
 */
function failures(spec) {
  const host = el("div");
  const draw = (width) => {
    // Where there is no space beside the points, words stand above them.
    const narrow = width < 480,
      left = narrow ? 14 : 210,
      right = 20,
      row = 20,
      head = narrow ? 22 : 0,
      gap = 16 + head,
      top = 8;
    const tall = spec.groups.map((g) => g.rates.filter(Boolean).length * row + gap);
    const height = top + tall.reduce((a, b) => a + b, 0) + 46;
    const high = Math.min(
      1,
      Math.max(
        0.002,
        ...spec.groups.flatMap((g) => g.rates.filter(Boolean).map((r) => 1 - r.low)),
      ) * 1.06,
    );
    const X = SCALES.sqrt(0, high),
      px = (v) => left + X.at(v) * (width - left - right),
      base = height - 46;
    const svg = el("svg", {
      viewBox: `0 0 ${width} ${height}`,
      role: "img",
      tabindex: 0,
      "aria-label": spec.title + ". Arrow keys go through the values.",
    });
    let last = -99;
    for (const t of X.ticks) {
      svg.append(el("line", { class: "grid", x1: px(t), x2: px(t), y1: top, y2: base }));
      if (px(t) - last < 40) continue;
      last = px(t);
      svg.append(
        el("text", {
          x: px(t),
          y: base + 18,
          "text-anchor": "middle",
          text: short(100 * t) + " %",
        }),
      );
    }
    svg.append(
      el("text", {
        x: (left + width - right) / 2,
        y: height - 6,
        "text-anchor": "middle",
        text: spec.label,
      }),
    );
    const seen = [];
    let y = top;
    spec.groups.forEach((group, g) => {
      const middle = y + tall[g] / 2,
        [name, what] = narrow
          ? [
              { x: 0, y: y + 18 },
              { x: 62, y: y + 18 },
            ]
          : [
              { x: 0, y: middle - 2 },
              { x: 0, y: middle + 13 },
            ];
      svg.append(
        el("text", { ...name, style: "font-weight:600", text: group.name }),
        el("text", { ...what, class: "soft", text: group.what || "" }),
        el("line", { class: "grid", x1: 0, x2: width - right, y1: y + tall[g], y2: y + tall[g] }),
      );
      y += head + (gap - head) / 2;
      group.rates.forEach((rate, i) => {
        if (!rate) return;
        const s = spec.series[i],
          [v, low, high] = [1 - rate.rate, Math.max(0, 1 - rate.high), 1 - rate.low],
          cy = y + row / 2;
        svg.append(
          el("line", {
            x1: px(low),
            x2: px(high),
            y1: cy,
            y2: cy,
            stroke: s.color,
            "stroke-width": 3,
            opacity: 0.45,
            "stroke-linecap": "round",
          }),
          el("circle", { cx: px(v), cy, r: 4.5, fill: s.color }),
        );
        seen.push({
          px: px(v),
          py: cy,
          words:
            `${group.name}, ${s.name}\n${interval({ rate: v, low, high })} ${spec.label}` +
            (rate.trials ? `\n${rate.trials - rate.successes} of ${rate.trials} trials` : ""),
        });
        y += row;
      });
      y += (gap - head) / 2;
    });
    inspect(svg, seen, [width, height]);
    return svg;
  };
  responsive(host, draw);
  const rows = spec.groups.flatMap((g) =>
    g.rates
      .map(
        (r, i) =>
          r && [g.name, spec.series[i].name, interval(r), r.trials ? String(r.trials) : "\u2013"],
      )
      .filter(Boolean),
  );
  return el(
    "figure",
    {},
    el("h3", { text: spec.title }),
    legend(spec.series),
    host,
    el("figcaption", { text: spec.note || "" }),
    values(["views", "by", "success [95 %]", "trials"], rows),
  );
}
