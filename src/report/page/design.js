// The page of a design: the ball, its stencil, its rates, what a camera makes of them, how it was found.

function designPage(d) {
  tiles(d);
  // What a maker needs first, what explains it last.
  if (d.stencil) MAIN.append(el("div", { class: "two" }, printSection(d), drawSection(d)));
  const ball = ballSection(d);
  if (d.stencil) stencilSection(d);
  if (d.validation.length) ratesSection(d);
  const noise = d.sensitivity.length ? sensitivitySection(d) : null;
  cameraSection(d, noise);
  dotSection(d, ball);
  if (d.search) searchSection(d);
  repeatSection(d);
  if (d.features) featureSection(d, ball);
}

function tiles(d) {
  const rate = (name) => d.validation.find((v) => v.recognizer === "robust" && v.protocol === name);
  const row = [
    tile(
      String(d.dots.length),
      `dots of ${fixed(d.dot_diameter_mm, 1)} mm on a ball of ${fixed(d.ball_diameter_mm, 1)} mm`,
    ),
    tile(fixed(d.summary.min_separation_deg, 1) + "\u00b0", "smallest angle between two dots"),
    tile(String(d.summary.min_visible), "dots in view from every side, at least"),
  ];
  const sparse = rate("sparse"),
    paper = rate("paper");
  if (d.ranking) row.push(...rankingTiles(d.ranking));
  else if (sparse)
    row.push(rateTile(sparse.answered, "of views answered right where four dots are given"));
  if (paper)
    row.push(
      tile(
        fixed(paper.mean_error_deg, 2) + "\u00b0",
        `mean orientation error with ${fixed(paper.sigma_deg, 0)}\u00b0 of noise per dot`,
      ),
    );
  row.push(
    tile(
      `${fixed(d.bound.mean, 2)} / ${fixed(d.bound.worst, 2)}`,
      "orientation error over a dot's noise, mean / worst view (Cram\u00e9r-Rao bound)",
    ),
  );
  tileRow(...row);
}

/** What was measured on rendered frames of the camera that the design was for. */
function rankingTiles({ frames, winner }) {
  return [
    rateTile(winner.right, `of ${frames} rendered frames of your camera, others than chose it, answered right`),
    tile(fixed(winner.mean_error_deg, 2) + "\u00b0", "mean orientation error of those frames"),
  ];
}

/** What is said of a dot. */
function dotWords(d, i) {
  const p = d.dots[i],
    lines = [`dot ${i}`, `x ${fixed(p[0], 4)}  y ${fixed(p[1], 4)}  z ${fixed(p[2], 4)}`];
  const near = neighbors(d, i);
  lines.push(
    `nearest: ${near
      .slice(0, 3)
      .map((n) => `${n.dot} (${fixed(n.angle, 1)}\u00b0)`)
      .join(", ")}`,
  );
  if (d.dot_features) {
    const f = d.dot_features[i];
    lines.push(
      `${f.count} hash features; the nearest to another dot's is ${short(f.nearest)} away (median ${short(f.median)})`,
    );
  }
  if (d.stencil) {
    const s = d.stencil.dots[i];
    lines.push(
      `stencil: half ${s.half.toUpperCase()}${s.through_both_rims ? ", through both rims" : ""}`,
    );
  }
  return lines.join("\n");
}

/** A time in words: seconds below two minutes. */

const neighbors = (d, i) =>
  d.dots
    .map((p, dot) => ({ dot, angle: angleBetween(p, d.dots[i]) }))
    .filter((n) => n.dot !== i)
    .sort((a, b) => a.angle - b.angle);

function ballSection(d) {
  const node = section(
    "ball",
    "The ball",
    null,
    "Drag to turn it, pinch or press + and \u2212 to zoom. With the keyboard: arrow keys turn, N and P go from dot to dot, Home resets.",
  );
  const state = { numbers: true, seam: true, zones: true, chosen: -1 },
    angle = Math.asin(d.dot_diameter_mm / d.ball_diameter_mm);
  const info = el("pre", { id: "dot-info", "aria-live": "polite", text: "Point at a dot." });
  const choose = (i, turn) => {
    if (i === state.chosen) return;
    state.chosen = i;
    info.textContent = i < 0 ? "Point at a dot." : dotWords(d, i);
    for (const row of document.querySelectorAll("#dots tbody tr"))
      row.classList.toggle("chosen", Number(row.dataset.dot) === i);
    if (turn && i >= 0) view.face(d.dots[i]);
    view.draw();
  };
  const view = new View(
    `The ball with ${d.dots.length} numbered dots. Arrow keys turn it, N and P go from dot to dot.`,
    (v) => {
      const ball = {
        center: [0, 0, 0],
        radius: 1,
        turn: IDENTITY,
        dots: d.dots,
        dotAngle: angle,
        zones: state.zones ? d.keep_out : [],
        seam: state.seam && d.stencil ? d.stencil.seam_normal : null,
        chosen: state.chosen,
      };
      const axes = tripod(v, IDENTITY, 1.12),
        labels = state.numbers ? dotLabels(v, ball, 1.12) : [];
      if (state.zones)
        for (const z of d.keep_out)
          if (times(v.turn, z.axis)[2] > 0.3)
            labels.push({ at: z.axis, text: "kept free", color: "--zone", size: 13 });
      for (const place of d.added)
        axes.lines.push(...ringLines(v, place.direction, 1.25 * angle, "--c2", false));
      return { reach: 1.12, ball, lines: axes.lines, labels: labels.concat(axes.labels) };
    },
    {
      hover: (direction, x, y) => {
        if (!direction) return tip(null);
        let best = -1,
          least = (angle * 1.4) / DEG;
        d.dots.forEach((p, i) => {
          const a = angleBetween(p, direction);
          if (a < least) {
            least = a;
            best = i;
          }
        });
        if (best >= 0) {
          choose(best);
          tip(dotWords(d, best), x, y);
        } else tip(null);
      },
      key: (key) => {
        const step = { n: 1, p: -1 }[key.toLowerCase()];
        if (!step) return false;
        choose((state.chosen + step + d.dots.length) % d.dots.length, true);
        return true;
      },
    },
  );
  const set = (name) => (on) => {
    state[name] = on;
    view.draw();
  };
  const sides = el(
    "select",
    {
      "aria-label": "Seen from",
      onchange: () => {
        if (sides.value) view.face(JSON.parse(sides.value));
      },
    },
    ...[
      ["+z (front)", [0, 0, 1]],
      ["\u2212z (back)", [0, 0, -1]],
      ["+x", [1, 0, 0]],
      ["\u2212x", [-1, 0, 0]],
      ["+y", [0, 1, 0]],
      ["\u2212y", [0, -1, 0]],
      ...d.keep_out.map((z, i) => [`zone ${i + 1}`, z.axis]),
    ].map(([text, v]) => el("option", { value: JSON.stringify(v), text })),
  );
  const controls = [
    checkbox("numbers", true, set("numbers")),
    d.stencil ? checkbox("seam", true, set("seam")) : null,
    d.keep_out.length ? checkbox("zones kept free", true, set("zones")) : null,
    el("label", {}, "from", sides),
    el("button", { type: "button", text: "Reset", onclick: () => view.reset() }),
  ];
  const seam = d.stencil ? "The line is the stencil's seam. " : "";
  const zones = d.keep_out.length
    ? `Hatched: ${d.keep_out.length === 1 ? "the zone" : "zones"} kept free of dots (half angle ${d.keep_out.map((z) => fixed(z.half_angle_rad / DEG, 1) + "\u00b0").join(", ")}). `
    : "";
  node.append(
    turnable(view, {
      controls,
      caption: `${seam}${zones}${d.added.length ? "Green rings: dots to be drawn beside the others. " : ""}Frame of the pattern: x right, y up, z towards the viewer at the start.`,
      beside: [
        el("h3", { class: "screen-only", text: "Dot" }),
        info,
        el("h3", { text: "Pattern" }),
        list([
          ["SHA-256", d.sha256],
          ["dots", String(d.dots.length)],
          ["smallest separation", fixed(d.summary.min_separation_deg, 2) + "\u00b0"],
          ["mean nearest separation", fixed(d.summary.mean_nearest_separation_deg, 2) + "\u00b0"],
          [
            "in view",
            `at least ${d.summary.min_visible}, on average ${fixed(d.summary.mean_visible, 1)}`,
          ],
          [
            "zones kept free",
            d.keep_out.length
              ? d.keep_out
                  .map(
                    (z) =>
                      `${fixed(z.half_angle_rad / DEG, 1)}\u00b0 about (${z.axis.map((c) => fixed(c, 3)).join(", ")})`,
                  )
                  .join("; ")
              : "none",
          ],
        ]),
      ],
    }),
  );
  view.choose = choose;
  return view;
}

function stencilSection(d) {
  const s = d.stencil;
  const node = section(
    "stencil",
    "The stencil",
    "Two printed half shells close around the ball; a pen draws through the holes.",
    "Open it with the slider.",
  );
  const halves = s.halves.map(corners),
    size = s.parameters,
    ground = s.engraving_radius_mm,
    state = { open: 0, ball: true, a: true, b: true };
  const turn = fromQuaternion(s.rotation_wxyz),
    hinge = [s.axis_mm, 0, 0];
  const reach = 0.62 * (s.axis_mm * 2 + 8);
  const open = el("input", {
    type: "range",
    min: 0,
    max: 150,
    value: 0,
    "aria-label": "Opening, degrees",
    oninput: () => {
      state.open = Number(open.value);
      angle.textContent = open.value + "\u00b0";
      view.draw();
    },
  });
  const angle = el("output", { text: "0\u00b0" });
  const view = new View(
    "The stencil's halves around the ball. Arrow keys turn them.",
    () => {
      const swung = rotation([0, 1, 0], -state.open * DEG);
      // Half B lies in its file turned about x; then it swings about the hinge, and the ball with it.
      const flipped = multiply(swung, [1, 0, 0, 0, -1, 0, 0, 0, -1]);
      const center = hinge.map((c, i) => c - times(swung, hinge)[i]);
      // The middle of both halves stays in the middle of the view.
      const aside = center.map((c) => -0.5 * c);
      const down = [0, 0, -s.lip_mm];
      const sum = (...vectors) => [0, 1, 2].map((i) => vectors.reduce((t, v) => t + v[i], 0));
      const shell = { hub: [0, 0, s.lip_mm], ground };
      const meshes = [];
      if (state.a)
        meshes.push({
          ...shell,
          mesh: halves[0],
          turn: IDENTITY,
          shift: sum(down, aside),
          paint: "--half-a",
        });
      if (state.b)
        meshes.push({
          ...shell,
          mesh: halves[1],
          turn: flipped,
          shift: sum(times(flipped, down), center, aside),
          paint: "--half-b",
        });
      const ball = {
        center: sum(center, aside),
        radius: d.ball_diameter_mm / 2,
        turn: multiply(swung, turn),
        dots: d.dots,
        dotAngle: Math.asin(d.dot_diameter_mm / d.ball_diameter_mm),
        zones: d.keep_out,
        chosen: -1,
      };
      return {
        reach: reach * (1 + (state.open / 150) * 0.75),
        ball: state.ball ? ball : null,
        meshes,
        labels: [],
        lines: [],
      };
    },
    { turn: multiply(rotation([1, 0, 0], -65 * DEG), rotation([0, 0, 1], 35 * DEG)) },
  );
  const set = (name) => (on) => {
    state[name] = on;
    view.draw();
  };
  const swing = () => {
    const to = state.open > 60 ? 0 : 110,
      from = state.open,
      start = performance.now(),
      still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const step = (now) => {
      const t = still ? 1 : Math.min(1, (now - start) / 700);
      open.value = from + (to - from) * (t * t * (3 - 2 * t));
      open.dispatchEvent(new Event("input"));
      if (t < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  };
  const count = (half) => s.dots.filter((x) => x.half === half && !x.through_both_rims).length;
  node.append(
    turnable(view, {
      controls: [
        el("button", { type: "button", id: "swing", text: "Open / close", onclick: swing }),
        el("label", {}, "opened", open, angle),
        checkbox("half A", true, set("a")),
        checkbox("half B", true, set("b")),
        checkbox("ball", true, set("ball")),
        el("button", { type: "button", text: "Reset", onclick: () => view.reset() }),
      ],
      caption: "Half A orange, half B blue, as their STL files have them.",
      beside: [
        el("h3", { text: "Sizes" }),
        list([
          ["ball", fixed(d.ball_diameter_mm, 2) + " mm"],
          ["holes", fixed(d.dot_diameter_mm, 2) + " mm at the ball"],
          ["clearance", fixed(s.parameters.clearance_mm, 2) + " mm per side"],
          ["wall", fixed(s.parameters.wall_mm, 2) + " mm"],
          [
            "holes in half A alone / in B alone / through both rims",
            `${count("a")} / ${count("b")} / ${s.dots.filter((x) => x.through_both_rims).length}`,
          ],
          ["nearest dot to the seam", fixed(s.seam_margin_deg, 1) + "\u00b0"],
          ...s.boxes.map((box, i) => [
            `half ${"AB"[i]}`,
            box.map((c) => fixed(c, 1)).join(" \u00d7 ") +
              " mm, " +
              fixed(s.volumes_mm3[i] / 1000, 1) +
              " cm\u00b3",
          ]),
        ]),
      ],
    }),
  );
}

function ratesSection(d) {
  const trials = d.validation[0].samples;
  const node = section(
    "rates",
    "How often it is answered right",
    `Failures of ${trials.toLocaleString("en")} simulated views per row, with 95 % intervals: a view fails when it shows too few dots, or when the orientation is not found within 20\u00b0. These trials chose nothing in the search.`,
  );
  const series = [],
    add = (name, color, of, recognizer) => series.push({ name, color, of, recognizer });
  for (const [r, color] of [
    ["robust", "var(--c0)"],
    ["voting", "var(--c1)"],
  ]) {
    add(`this pattern, ${RECOGNIZERS[r]}`, color, d.validation, r);
    if (d.published)
      add(
        `published pattern, ${RECOGNIZERS[r]}`,
        r === "robust" ? "var(--c4)" : "var(--c5)",
        d.published.validation,
        r,
      );
  }
  const comparable = (name) => d.standard_protocols.includes(name);
  const groups = Object.keys(PROTOCOLS)
    .map((name) => ({
      name: PROTOCOLS[name][0],
      what: comparable(name) ? PROTOCOLS[name][1] : "as this search has it",
      rates: series.map((s) => {
        if (s.of !== d.validation && !comparable(name)) return null;
        const v = s.of.find((x) => x.recognizer === s.recognizer && x.protocol === name);
        return v ? success(v) : null;
      }),
    }))
    .filter((g) => g.rates.some(Boolean));
  node.append(
    failures({
      title: "Views not answered right",
      label: "of the views fail",
      series,
      groups,
      note:
        "The axis is a square root, so that small rates and zero can both be seen." +
        (d.published
          ? ` The published SpinDOE pattern: ${d.published.samples.toLocaleString("en")} trials, seed ${d.published.seed}.`
          : ""),
    }),
  );
  node.append(
    el("h3", { text: "Orientation error of the views answered right, and views with too few dots" }),
    table(
      ["views", "recognizer", "mean", "median", "right, of all", "all dots right, of those with enough", "too few dots"],
      // Of reports of before the baseline came first.
      [...d.validation.filter((v) => v.recognizer !== "voting"), ...d.validation.filter((v) => v.recognizer === "voting")].map((v) => [
        PROTOCOLS[v.protocol]?.[0] || v.protocol,
        RECOGNIZERS[v.recognizer] || v.recognizer,
        v.mean_error_deg === null ? "\u2013" : fixed(v.mean_error_deg, 3) + "\u00b0",
        v.median_error_deg === null ? "\u2013" : fixed(v.median_error_deg, 3) + "\u00b0",
        interval(v.answered),
        v.identity.trials ? interval(v.identity) : "\u2013",
        percent(v.skipped / v.samples),
      ]),
    ),
  );
}

function sensitivitySection(d) {
  const swept = (parameter) => d.sensitivity.filter((p) => p.parameter === parameter);
  const first = d.sensitivity[0];
  const node = section(
    "sensitivity",
    "How it depends on noise",
    `${first.samples.toLocaleString("en")} views per point in the \u201c${first.protocol}\u201d protocol. The dashed line is your noise, from the next section.`,
  );
  const lines = (points) => {
    const out = [];
    for (const [r, color, pale] of [
      ["robust", "var(--c0)", "var(--c4)"],
      ["voting", "var(--c1)", "var(--c5)"],
    ])
      for (const [what, c] of [
        ["answered", color],
        ["identity", pale],
      ]) {
        const of = points.filter((p) => p.recognizer === r);
        if (of.length)
          out.push({
            name: `${RECOGNIZERS[r]}, ${what === "answered" ? "right, of all views" : "all dots right, of views with enough"}`,
            color: c,
            points: of.map((p) => ({
              x: p.value,
              y: p[what].rate,
              low: p[what].low,
              high: p[what].high,
            })),
          });
      }
    return out;
  };
  const axis = { label: "success", format: percent, tick: wholePercent, high: 1 };
  const sigma = swept("sigma_deg"),
    alpha = swept("alpha");
  const charts = el("div", { class: "two" });
  const chart = sigma.length
    ? curves({
        title: "Noise of a dot",
        x: { label: "sigma [deg]" },
        y: axis,
        series: lines(sigma),
        note:
          d.sigma_per_noise > 1
            ? "Shaded: 95 % intervals. Sigma is the angle of a rotation about a random axis: \u221a3 times a dot's noise per axis."
            : "Shaded: 95 % intervals.",
      })
    : null;
  if (chart) charts.append(chart);
  if (alpha.length)
    charts.append(
      curves({
        title: "The paper's alpha",
        x: { label: "alpha", scale: "log" },
        y: axis,
        series: lines(alpha),
        note: "A parameter of the paper's recognizer.",
      }),
    );
  node.append(charts);
  if (!chart) return null;
  return (degrees) => chart.mark(degrees, `yours: ${fixed(degrees, 1)}\u00b0`);
}

/** What a camera makes of a pattern, in closed form. */
function cameraFigures({ pixels, noise, rate, frames }, bound) {
  const sigma = noise / (pixels / 2),
    error = bound.mean * sigma,
    worst = bound.worst * sigma;
  // Slope of a line through equidistant angles; as the bound, the root of the mean square over all three axes.
  const spin = (e) => e * rate * Math.sqrt(12 / (frames * (frames * frames - 1)));
  return {
    sigma_deg: sigma / DEG,
    error_deg: error / DEG,
    worst_deg: worst / DEG,
    spin_rps: spin(error) / (2 * Math.PI),
    spin_worst_rps: spin(worst) / (2 * Math.PI),
    alias_rps: rate / 2,
  };
}

function cameraSection(d, mark) {
  const node = section(
    "camera",
    "What your camera can expect",
    mark ? "The first value is the noise that the curves above are marked with." : null,
    "Fill in your camera.",
  );
  const given = { ...d.camera },
    out = el("div", { class: "tiles", id: "camera-figures", "aria-live": "polite" });
  const update = () => {
    const f = cameraFigures(given, d.bound);
    out.replaceChildren(
      tile(fixed(f.sigma_deg, 2) + "\u00b0", "noise of a dot per axis, in the middle of the ball"),
      tile(
        `${fixed(f.error_deg, 2)}\u00b0 / ${fixed(f.worst_deg, 2)}\u00b0`,
        "orientation error with dots of that noise, mean / worst view",
      ),
      tile(
        `${fixed(f.spin_rps, 3)} / ${fixed(f.spin_worst_rps, 3)} rps`,
        `error of the spin from ${given.frames} frames, mean / worst view`,
      ),
      tile(fixed(f.alias_rps, 0) + " rps", "alias limit: faster spins look like slower ones"),
      ...(d.ranking ? rankingTiles(d.ranking) : []),
    );
    if (mark) mark(f.sigma_deg * d.sigma_per_noise);
  };
  const field = (name, text, step, low) => {
    const box = el("input", {
      type: "number",
      step,
      min: low,
      value: given[name],
      id: "camera-" + name,
      oninput: () => {
        const v = Number(box.value);
        if (Number.isFinite(v) && v >= low) {
          given[name] = v;
          update();
        }
      },
    });
    return el("label", {}, text, box);
  };
  node.append(
    el(
      "div",
      { class: "controls" },
      field("pixels", "ball in the image [px]", 1, 4),
      field("noise", "error of a dot [px]", 0.1, 0.01),
      field("rate", "frames per second", 10, 1),
      field("frames", "frames of a spin", 1, 3),
    ),
    out,
    el("p", {
      class: "lead",
      text: "Noise: error over the ball's radius in pixels. Orientation: the Cram\u00e9r-Rao bound of the dots in view times that noise (root mean square, three axes together): no estimate from dots of this noise is better, and one that misses dots is worse. Spin: the slope through n such orientations at rate f, \u03c3 f \u221a(12 / n(n\u00b2\u22121)). Alias: at rate f, spins beyond f/2 revolutions per second cannot be distinguished from slower ones by one sequence at equal intervals.",
    }),
  );
  update();
}

function searchSection(d) {
  const s = d.search;
  const node = section(
    "search",
    "How it was found",
    `${s.starts} random starts${s.stopped ? "; stopped before its end" : ""}. Objective ${s.objective.name}: ${fixed(s.objective.value, 4)}.`,
  );
  const point = (m) => ({
    x: m.rounds,
    y: 1 - m.answered.rate,
    low: 1 - m.answered.high,
    high: 1 - m.answered.low,
  });
  const charts = el("div", { class: "two" });
  if (s.milestones.length > 1) {
    const series = [
      { name: "best so far", color: "var(--c0)", points: s.milestones.map(point) },
    ];
    charts.append(
      curves({
        title: "The best so far",
        x: { label: "rounds of the search" },
        y: {
          label: `\u201c${s.protocol}\u201d views that fail`,
          format: percent,
          tick: wholePercent,
          low: 0,
        },
        series,
        note: "On trials of their own that select nothing.",
      }),
    );
  } else if (s.milestones.length)
    node.append(
      el("p", {
        text: `After one round: ${interval(s.milestones[0].answered)} of ${s.milestones[0].answered.trials.toLocaleString("en")} \u201c${s.protocol}\u201d views answered right.`,
      }),
    );
  if (s.finalists.length)
    charts.append(
      el(
        "figure",
        {},
        el("h3", { text: "Finalists" }),
        table(
          ["start", "objective", "right, of all views [95 %]"],
          s.finalists
            .slice(0, 10)
            .map((f) => [
              String(f.start),
              fixed(f.value, 4),
              f.answered ? interval(f.answered) : "\u2013",
            ]),
        ),
        el("figcaption", {
          text: "Rates on the selection's trials, by which the first was chosen: the best of many is best by chance too.",
        }),
      ),
    );
  node.append(charts);
  if (s.finalists.some((f) => f.answered) && d.validation.length)
    node.append(
      el("p", {
        class: "lead",
        text: "The search, its finalists and the rates above are measured on different trials, so their shares differ a little. Those above chose nothing: rely on them.",
      }),
    );
}

/** Features in hash space, colored by how near another one lies. */
function featureSection(d, ball) {
  const f = d.features;
  const node = section(
    "features",
    "Hash features",
    `${f.total.toLocaleString("en")} features h of ${d.dots.length} dots in two of their three coordinates. The nearer another feature lies, the more a point stands out, and the easier it is confused.`,
    "Point at one to see its dots.",
  );
  const canvas = el("canvas", {
      tabindex: 0,
      role: "img",
      "aria-label": "Hash features",
      style: "width:100%;height:auto;display:block",
    }),
    scale = el("span", { class: "ramp" }),
    host = el(
      "figure",
      {},
      el("div", { class: "legend" }, el("span", {}, "another one near ", scale, " far")),
      canvas,
      el("figcaption", {
        text: `Shown are the features within ${short(f.reach)} of the origin${f.shown < f.total ? `, 1 in ${Math.round(f.total / f.shown)} of all` : ""}.`,
      }),
    );
  node.append(host);
  // From near to far, away from the background to near it.
  const ramp = [
    [68, 1, 84],
    [59, 81, 139],
    [33, 144, 141],
    [92, 200, 99],
    [240, 210, 40],
  ];
  const onDark = [
    [253, 231, 37],
    [122, 209, 81],
    [34, 158, 141],
    [62, 96, 148],
    [88, 64, 120],
  ];
  const isDark = () => document.documentElement.dataset.theme === "dark";
  const color = (stops, q) => {
    const t = q * 3.999,
      i = Math.floor(t);
    return `rgb(${stops[i].map((c, k) => Math.round(c + (stops[i + 1][k] - c) * (t - i)))})`;
  };
  // The nearest ones last, on top of the others.
  const order = [...f.points].sort((a, b) => b[5] - a[5]);
  let size = [0, 0];
  const px = (v) => ((v / f.reach + 1) / 2) * size[0],
    py = (v) => ((1 - v / f.reach) / 2) * size[1];
  const draw = () => {
    const width = Math.max(200, host.clientWidth - 28);
    size = [width, Math.min(width * 0.62, 520)];
    canvas.width = size[0] * 2;
    canvas.height = size[1] * 2;
    const stops = isDark() ? onDark : ramp;
    scale.style.background = `linear-gradient(to right, ${stops.map((c) => `rgb(${c})`)})`;
    const ink = canvas.getContext("2d");
    ink.scale(2, 2);
    // Paper shows what is transparent as white.
    ink.fillStyle = css("--panel");
    ink.fillRect(0, 0, size[0], size[1]);
    ink.strokeStyle = css("--line");
    ink.beginPath();
    ink.moveTo(0, py(0));
    ink.lineTo(size[0], py(0));
    ink.moveTo(px(0), 0);
    ink.lineTo(px(0), size[1]);
    ink.stroke();
    order.forEach(([x, y, , , , q]) => {
      ink.fillStyle = color(stops, q);
      ink.beginPath();
      ink.arc(px(x), py(y), 1.7, 0, 7);
      ink.fill();
    });
    ink.fillStyle = css("--soft");
    ink.font = "13px system-ui, sans-serif";
    ink.fillText("h1", size[0] - 22, py(0) - 8);
    ink.fillText("h2", px(0) + 8, 14);
  };
  new ResizeObserver(draw).observe(host);
  RESTYLED.push(draw);
  canvas.addEventListener("pointermove", (e) => {
    const box = canvas.getBoundingClientRect(),
      x = e.clientX - box.left,
      y = e.clientY - box.top;
    let best = null,
      least = 12 ** 2;
    for (const p of f.points) {
      const r = (px(p[0]) - x) ** 2 + (py(p[1]) - y) ** 2;
      if (r < least) {
        least = r;
        best = p;
      }
    }
    if (!best) return tip(null);
    tip(
      `dot ${best[4]} in the basis of dots ${best[2]} and ${best[3]}\nh1 ${fixed(best[0], 2)}, h2 ${fixed(best[1], 2)}\nnearer to another feature than ${percent(1 - best[5])} of them`,
      e.pageX,
      e.pageY,
    );
    ball.choose(best[4]);
  });
  canvas.addEventListener("pointerleave", () => tip(null));
}

function dotSection(d, ball) {
  const node = section(
    "dots",
    "The dots",
    "Unit vectors in the pattern's frame, numbered as in pattern.csv and on the stencil.",
  );
  const heads = ["dot", "x", "y", "z", "nearest", "angle"].concat(
    d.stencil ? ["half", "latitude", "azimuth"] : [],
  );
  const made = table(
    heads,
    d.dots.map((p, i) => {
      const near = neighbors(d, i)[0],
        s = d.stencil?.dots[i];
      return [
        String(i),
        ...p.map((c) => fixed(c, 5)),
        String(near.dot),
        fixed(near.angle, 2) + "\u00b0",
      ].concat(
        s
          ? [
              s.through_both_rims ? "A + B" : s.half.toUpperCase(),
              fixed(s.latitude_deg, 1) + "\u00b0",
              fixed(s.azimuth_deg, 1) + "\u00b0",
            ]
          : [],
      );
    }),
  );
  [...made.querySelectorAll("tbody tr")].forEach((row, i) => {
    row.dataset.dot = i;
    row.addEventListener("click", () => ball.choose(i, true));
  });
  node.append(made);
  if (d.stencil)
    node.append(
      el("p", {
        class: "lead",
        text: "Half, latitude and azimuth are the stencil's: latitude above its seam, azimuth from the hinge.",
      }),
    );
}

function printSection(d) {
  const stencil = d.stencil,
    s = stencil.parameters,
    part = s.segments > 1 ? "piece" : "half",
    bed = stencil.beds[0];
  const node = section(
    "print",
    "Print it",
    "Measure the ball with a caliper first: table-tennis balls are 40.0 to 40.6 mm. The coupon (spindoe stencil --coupon) finds your printer's clearance.",
  );
  const rows = [
    ["files", `stencil/stencil.3mf, or each ${part} as STL`],
    ["nozzle", `${fixed(s.nozzle_mm, 2)} mm`],
    ["layers", "0.2 mm, at least two perimeters"],
    ["supports", `none: each ${part} as it is in its file, rim down`],
    [
      "filament",
      `about ${fixed((stencil.volumes_mm3.reduce((a, b) => a + b, 0) / 1000) * 1.24, 0)} g of PLA at full infill`,
    ],
    [
      "hinge",
      s.closure === "pin"
        ? "the printed pin"
        : `M${short(s.screw_diameter_mm)} screw of at least ${Math.ceil(s.hinge_length_mm + 3)} mm with a lock nut`,
    ],
  ];
  if (stencil.print_size_mm)
    rows.splice(1, 0, [
      "bed",
      `a ${part} takes ${stencil.print_size_mm.map((c) => fixed(c, 0)).join(" \u00d7 ")} mm: ` +
        (bed ? `${bed.printers}, and larger ones` : "no common bed holds it"),
    ]);
  node.append(list(rows));
  return node;
}

function drawSection(d) {
  const node = section("draw", "Draw it", null);
  const steps = [
    "Lay the ball in half B, close half A, and hold the stencil at its tab.",
    `Draw through the holes with a permanent marker: first around the edge, ${fixed(d.dot_diameter_mm, 1)} mm wide at the ball, then fill.`,
    "Leave the ball in until the ink is dry.",
    "The number beside each hole is the dot's in every table here. Numbers that read as another upside down, such as 6, 9 and 19, are underlined.",
    "stencil/drawing.pdf has the sections and the table of holes. Without a printer: spindoe mark.",
  ];
  node.append(el("ol", {}, ...steps.map((text) => el("li", { text }))));
  return node;
}

function repeatSection(d) {
  const seeds = Object.entries(d.seeds).map(([k, v]) => `${k} ${v}`);
  repeatable(
    d.command,
    "No command repeats this pattern: it was not made by one, or its search was stopped.",
    [
      ["seeds", seeds.join(", ") || "none"],
      ["made by", "spindoe " + d.spindoe_version],
      ["SHA-256 of the dots", d.sha256],
    ],
  );
}
