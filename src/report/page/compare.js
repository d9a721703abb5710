// The page of a comparison: patterns on the same trials.

function comparePage(d) {
  const colors = d.patterns.map((_, i) => `var(--c${i % 6})`);
  const balls = section(
    "balls",
    "The patterns",
    null,
    "All balls turn together: drag one, or use the arrow keys.",
  );
  const views = [];
  const row = el("div", { class: "frames balls" });
  d.patterns.forEach((p) => {
    const view = new View(`The ball of ${p.name}. Arrow keys turn it.`, (v) => {
      const ball = {
        center: [0, 0, 0],
        radius: 1,
        turn: IDENTITY,
        dots: p.dots,
        dotAngle: d.dot_angle_rad,
        chosen: -1,
      };
      return { reach: 1.12, ball, labels: dotLabels(v, ball, 1.12), lines: [] };
    });
    const paint = view.paint.bind(view);
    view.paint = () => {
      for (const other of views)
        if (other !== view && other.turn !== view.turn) {
          other.turn = view.turn;
          other.draw();
        }
      paint();
    };
    views.push(view);
    row.append(
      el(
        "figure",
        {},
        view.node,
        el("figcaption", { text: `${p.name}: ${p.dots.length} dots, ${p.sha256.slice(0, 12)}` }),
      ),
    );
  });
  balls.append(row);
  const rates = section(
    "rates",
    "How often they are identified",
    `${d.samples.toLocaleString("en")} views per row, the same rotations and noise for all patterns (seed ${d.seed}). A view fails when it shows too few dots, or when the orientation is not found within 20\u00b0.`,
  );
  for (const recognizer of ["robust", "voting"]) {
    const of = d.contests.filter((c) => c.recognizer === recognizer);
    if (!of.length) continue;
    const groups = Object.keys(PROTOCOLS).map((name) => ({
      name: PROTOCOLS[name][0],
      what: PROTOCOLS[name][1],
      rates: d.patterns.map((p) => {
        const c = of.find((x) => x.protocol === name && x.name === p.name);
        return c ? success(c) : null;
      }),
    }));
    rates.append(
      failures({
        title: `Views not answered right, ${RECOGNIZERS[recognizer]}`,
        label: "of the views fail",
        series: d.patterns.map((p, i) => ({ name: p.name, color: colors[i] })),
        groups,
        note: "The axis is a square root, so that small rates and zero can both be seen.",
      }),
    );
  }
  const signed = (x) => (x > 0 ? "+" : "") + fixed(100 * x, 2),
    paired = (p) => `${signed(p.difference)} [${signed(p.low)}, ${signed(p.high)}]`;
  const first = d.patterns[0].name;
  section(
    "differences",
    `Differences against ${first}`,
    "Percentage points on the same trials, with 95 % intervals for pairs. They do not correct for several comparisons.",
  ).append(
    table(
      ["views", "recognizer", "pattern", "right, of all views", "all dots right, of all views", "mean error"],
      d.contests
        .filter((c) => c.name !== first)
        .map((c) => [
          c.protocol,
          c.recognizer,
          c.name,
          paired(c.answered_difference),
          paired(c.identity_difference),
          fixed(c.mean_error_deg, 3) + "\u00b0",
        ]),
    ),
  );
  const deg = (x) => fixed(x / DEG, 2) + "\u00b0",
    objectives = [...new Set(d.patterns.flatMap((p) => p.objectives.map((o) => o.name)))];
  section("measures", "Values that need no trials", null).append(
    table(
      ["", ...d.patterns.map((p) => p.name)],
      [
        ["smallest separation", ...d.patterns.map((p) => deg(p.summary.min_separation_rad))],
        ["dots in view, at least", ...d.patterns.map((p) => String(p.summary.min_visible))],
        [
          "orientation error the dots allow, mean / worst view, times a dot's noise",
          ...d.patterns.map(
            (p) => `${fixed(p.orientation_bound.mean, 3)} / ${fixed(p.orientation_bound.worst, 3)}`,
          ),
        ],
        [
          "mean distance to the nearest feature",
          ...d.patterns.map((p) => short(p.mean_feature_distance)),
        ],
        ...objectives.map((name) => [
          "objective " + name,
          ...d.patterns.map((p) => {
            const o = p.objectives.find((x) => x.name === name);
            return o ? fixed(o.value, 4) : "\u2013";
          }),
        ]),
        ["SHA-256", ...d.patterns.map((p) => p.sha256.slice(0, 16))],
      ],
    ),
  );
  repeatable(d.command, "", [
    ["trials", d.samples.toLocaleString("en")],
    ["seed", String(d.seed)],
  ]);
}
