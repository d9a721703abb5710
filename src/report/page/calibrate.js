// The page of a calibration: where each dot was drawn, how well that is known, and what it is worth.

/** How a dot's state is shown. */
const DOT_STATES = {
  measured: ["measured", "--accent"],
  unseen: ["not seen: left at its nominal place", "--soft"],
  doubtful: ["may be print or a stain", "--soft"],
  missing: ["never found where it should be: left out", "--bad"],
};

/** Whether there are places that were meant: a ball whose pattern was built from the clip alone has none. */
const isDesign = (d) => Boolean(d.nominal_sha256);
/** What a dot's state is called. */
const stateWords = (d, state) =>
  isDesign(d) || state !== "unseen" ? DOT_STATES[state][0] : "seen too seldom to be measured";

function calibratePage(d) {
  calibrationTiles(d);
  adviceSection(d);
  dotSetSection(d);
  const ball = drawnBall(d);
  if (isDesign(d)) offsetSection(d);
  coverageSection(d);
  residualSection(d);
  if (d.monte_carlo.length) worthSection(d);
  drawnDots(d, ball);
  if (d.marks.length) markSection(d);
  repeatable(d.command, "The command that made this folder is not in its report.json.", [
    ...(isDesign(d)
      ? [
          ["nominal pattern", d.nominal_sha256],
          ["calibrated pattern", d.pattern_sha256],
        ]
      : [["pattern, built from the clip alone", d.pattern_sha256]]),
    ["seed of the trials", String(d.seed)],
    ["made by", "spindoe " + d.spindoe_version],
  ]);
}

/** Whether something was seen in the dot's place. */
const isSeen = (p) => p.state === "measured" || p.state === "doubtful";
const inState = (d, state) => d.dots.filter((dot) => dot.state === state);

function calibrationTiles(d) {
  const h = d.held_out,
    row = [
      tile(`${inState(d, "measured").length} of ${d.dots.length}`, "dots measured"),
      // What is built from the clip has no places that were meant.
      ...(isDesign(d)
        ? [
            tile(
              fixed(d.rms_offset_deg, 2) + "\u00b0",
              "rms distance of a drawn dot from its nominal place",
            ),
          ]
        : []),
      tile(`${d.frames.fitted} of ${d.frames.given}`, "frames used"),
    ];
  if (h.frames.length)
    row.push(
      isDesign(d)
        ? tile(
            `${fixed(h.median_deg[0], 2)}\u00b0 \u2192 ${fixed(h.median_deg[1], 2)}\u00b0`,
            "median residual of frames that took no part, before and after",
          )
        : tile(
            `${fixed(h.median_deg[1], 2)}\u00b0`,
            "median residual of frames that took no part",
          ),
    );
  for (const [state, words] of [
    ["missing", "never found where expected"],
    ["unseen", "shown by too few frames"],
    ["doubtful", "may be print or a stain"],
  ]) {
    const dots = inState(d, state),
      numbers = dots.map((dot) => dot.nominal_number).join(", ");
    // A number alone would be read as how many they are.
    if (dots.length) row.push(tile(`${dots.length === 1 ? "dot" : "dots"} ${numbers}`, words));
  }
  tileRow(...row);
}

function adviceSection(d) {
  if (d.advice.length)
    section("advice", "What to do", null).append(
      el("ul", {}, ...d.advice.map((line) => el("li", { text: line }))),
    );
}

/** Whether the dots are good as a set, and where one more would help. */
function dotSetSection(d) {
  if (d.dot_set_words.length)
    section(
      "dot-set",
      "Is this set of dots good?",
      `Simulated views, each read as a frame by itself; brackets are 95 % intervals. The numbers of dots are those of pattern.csv, as in dots.png.`,
    ).append(el("ul", {}, ...d.dot_set_words.map((line) => el("li", { text: line }))));
}

/** What is said of a dot. */
function drawnWords(d, i) {
  const p = d.dots[i],
    [north, east] = d.compass_deg[i],
    lines = [`dot ${p.nominal_number}: ${stateWords(d, p.state)}`];
  if (Number.isInteger(p.mark)) lines.push(`mark ${p.mark} of marks.png`);
  if (isSeen(p)) {
    if (isDesign(d))
      lines.push(
        `${fixed(p.offset_deg, 2)}\u00b0 off: ${fixed(north, 2)}\u00b0 north, ${fixed(east, 2)}\u00b0 east`,
      );
    lines.push(`standard deviation ${fixed(p.sigma_deg, 2)}\u00b0 per axis`);
  }
  lines.push(
    `seen in ${p.views} frame${p.views === 1 ? "" : "s"}, in ${p.facing_views} of the ${p.facing_frames} in which it faces the camera`,
  );
  if (p.number !== null && p.number !== p.nominal_number)
    lines.push(`dot ${p.number} of the calibrated pattern`);
  return lines.join("\n");
}

/** The direction `times` as far from `from` as `to` is, on the same great circle. */
function farther(from, to, by) {
  const c = Math.max(-1, Math.min(1, dot(from, to))),
    angle = Math.acos(c),
    side = to.map((x, k) => x - c * from[k]),
    length = Math.hypot(...side);
  if (length < 1e-9) return to;
  const turned = angle * by;
  return from.map((x, k) => Math.cos(turned) * x + (Math.sin(turned) * side[k]) / length);
}

/** The lines of a circle on the ball about a direction, where it faces the viewer. */
function ringLines(view, center, radius, color, dashed) {
  const helper = Math.abs(center[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0],
    cross = (a, b) => [
      a[1] * b[2] - a[2] * b[1],
      a[2] * b[0] - a[0] * b[2],
      a[0] * b[1] - a[1] * b[0],
    ],
    raw = cross(center, helper),
    length = Math.hypot(...raw),
    u = raw.map((x) => x / length),
    v = cross(center, u),
    steps = 28,
    at = (k) => {
      const t = (2 * Math.PI * k) / steps,
        s = Math.sin(radius);
      return center.map(
        (x, i) => 1.004 * (Math.cos(radius) * x + s * (Math.cos(t) * u[i] + Math.sin(t) * v[i])),
      );
    },
    lines = [];
  for (let k = 0; k < steps; k += dashed ? 2 : 1) {
    const [from, to] = [at(k), at(k + 1)];
    if (times(view.turn, from)[2] > 0 && times(view.turn, to)[2] > 0)
      lines.push({ from, to, color, width: 2 });
  }
  return lines;
}

function drawnBall(d) {
  const node = section(
    "ball",
    "The ball as drawn",
    isDesign(d)
      ? "Filled: dots where they are. Rings: where they should be."
      : "The dots as the clip shows them.",
    "Drag to turn it, pinch or press + and \u2212 to zoom; arrow keys turn, N and P go from dot to dot, Home resets.",
  );
  const info = el("pre", { id: "dot-info", "aria-live": "polite", text: "Point at a dot." }),
    state = { by: 1, numbers: true, chosen: -1 },
    // What is missing has no drawn place: only its ring is shown.
    present = d.dots.map((p, i) => ({ p, i })).filter(({ p }) => p.state !== "missing");
  const choose = (i, turn) => {
    if (i === state.chosen) return;
    state.chosen = i;
    info.textContent = i < 0 ? "Point at a dot." : drawnWords(d, i);
    for (const row of document.querySelectorAll("#dots tbody tr"))
      row.classList.toggle("chosen", Number(row.dataset.dot) === i);
    if (turn && i >= 0) view.face(d.dots[i].nominal);
    view.draw();
  };
  const view = new View(
    `The ball with ${d.dots.length} dots as drawn${isDesign(d) ? ", and rings where they should be" : ""}. Arrow keys turn it, N and P go from dot to dot.`,
    (v) => {
      const ball = {
        center: [0, 0, 0],
        radius: 1,
        turn: IDENTITY,
        dots: present.map(({ p }) => farther(p.nominal, p.drawn, state.by)),
        names: present.map(({ p }) => p.nominal_number),
        dotAngle: d.dot_angle_rad,
        zones: d.keep_out,
        chosen: present.findIndex(({ i }) => i === state.chosen),
      };
      const axes = tripod(v, IDENTITY, 1.12),
        labels = state.numbers ? dotLabels(v, ball, 1.12) : [],
        lines = axes.lines;
      d.dots.forEach((p) => {
        const color = DOT_STATES[p.state][1],
          dashed = p.state === "unseen" || p.state === "doubtful";
        if (isDesign(d) || p.state !== "measured")
          lines.push(...ringLines(v, p.nominal, d.dot_angle_rad, color, dashed));
        if (p.state === "missing" && times(v.turn, p.nominal)[2] > 0.1)
          labels.push({ at: p.nominal, text: String(p.nominal_number), color: "--bad", size: 13 });
      });
      for (const mark of d.marks) {
        lines.push(...ringLines(v, mark.direction, 0.6 * d.dot_angle_rad, "--seam", false));
        if (times(v.turn, mark.direction)[2] > 0.1)
          labels.push({ at: mark.direction, text: markName(mark), color: "--seam", size: 12 });
      }
      const add = d.dot_set && d.dot_set.add;
      if (add) {
        lines.push(...ringLines(v, add.direction, d.dot_angle_rad, "--c2", false));
        if (times(v.turn, add.direction)[2] > 0.1)
          labels.push({ at: add.direction, text: "add", color: "--c2", size: 12 });
      }
      return { reach: 1.12, ball, lines, labels: labels.concat(axes.labels) };
    },
    {
      hover: (direction, x, y) => {
        if (!direction) return tip(null);
        let best = -1,
          least = (d.dot_angle_rad * 1.6) / DEG;
        d.dots.forEach((p, i) => {
          const a = angleBetween(p.nominal, direction);
          if (a < least) {
            least = a;
            best = i;
          }
        });
        if (best < 0) return tip(null);
        choose(best);
        tip(drawnWords(d, best), x, y);
      },
      key: (key) => {
        const step = { n: 1, p: -1 }[key.toLowerCase()];
        if (!step) return false;
        choose((state.chosen + step + d.dots.length) % d.dots.length, true);
        return true;
      },
    },
  );
  const scale = el("input", {
      type: "range",
      min: 1,
      max: 10,
      value: 1,
      "aria-label": "Offsets enlarged, times",
      oninput: () => {
        state.by = Number(scale.value);
        by.textContent = scale.value + "\u00d7";
        view.draw();
      },
    }),
    by = el("output", { text: "1\u00d7" });
  node.append(
    turnable(view, {
      controls: [
        isDesign(d) ? el("label", {}, "offsets", scale, by) : null,
        checkbox("numbers", true, (on) => {
          state.numbers = on;
          view.draw();
        }),
        el("button", { type: "button", text: "Reset", onclick: () => view.reset() }),
      ],
      caption:
        (isDesign(d)
          ? "Blue rings: measured dots. Grey dashes: not seen, or doubtful. Red: never found. Orange: marks that the pattern lacks."
          : "Grey dashes: seen too seldom, or doubtful. Orange: marks that are taken for none of the dots.") +
        " Green: where one more dot helps most. Frame of the pattern: x right, y up, z towards the viewer at the start.",
      beside: [
        el("h3", { text: "Dot" }),
        info,
        el("h3", { text: "Calibration" }),
        list([
          ["frames given", String(d.frames.given)],
          ["with a ball", String(d.frames.with_ball)],
          ["with more than one ball", String(d.frames.with_other_balls)],
          ["used by the fit", String(d.frames.fitted)],
          ["rate at which a dot is found", percent(d.detection_rate)],
          ["detections' scatter", `${fixed(d.noise_scale, 2)} times what the detector states`],
          [
            "camera's distance",
            d.inverse_distance === null
              ? "as given"
              : d.inverse_distance > 0
                ? `${fixed(1 / d.inverse_distance, 1)} ball radii, fitted`
                : "far, fitted",
          ],
          ["smooth rotation", d.smooth ? "used" : "not used"],
        ]),
      ],
    }),
  );
  view.choose = choose;
  return view;
}

function offsetSection(d) {
  const dots = d.dots
    .map((p, i) => ({ p, compass: d.compass_deg[i] }))
    .filter(({ p }) => p.state === "measured");
  if (!dots.length) return;
  const far = 1.1 * Math.max(0.1, ...dots.flatMap(({ compass }) => compass.map(Math.abs))),
    name = (p) => `dot ${p.nominal_number}`;
  const charts = el("div", { class: "two" });
  charts.append(
    curves({
      title: "How far off each dot is",
      x: { label: "dot" },
      y: { label: "offset [deg]", low: 0, format: (v) => fixed(v, 2) },
      series: [
        {
          name: "offset, \u00b1 2 standard deviations",
          color: "var(--c0)",
          line: false,
          points: dots.map(({ p }) => ({
            x: p.nominal_number,
            y: p.offset_deg,
            low: Math.max(0, p.offset_deg - 2 * p.sigma_deg),
            high: p.offset_deg + 2 * p.sigma_deg,
          })),
        },
      ],
      note: "An interval that reaches zero: this dot may be where it should.",
    }),
    curves({
      title: "Which way",
      x: { label: "to the east [deg]", low: -far, high: far, format: (v) => fixed(v, 2) },
      y: { label: "to the north [deg]", low: -far, high: far, format: (v) => fixed(v, 2) },
      series: [
        {
          name: "dots",
          color: "var(--c1)",
          line: false,
          points: dots.map(({ p, compass }) => ({ x: compass[1], y: compass[0], note: name(p) })),
        },
      ],
      note: "North is towards the pattern's +z. Dots that are all off to one side indicate a stencil that sat askew.",
    }),
  );
  section(
    "offsets",
    "Offsets",
    "Drawn minus nominal, after the turn of the whole pattern that makes them smallest.",
  ).append(charts);
}

function coverageSection(d) {
  const of = (pick) => d.dots.map((p) => ({ x: p.nominal_number, y: pick(p) }));
  const charts = el("div", { class: "two" });
  charts.append(
    curves({
      title: "Frames in which each dot faces the camera",
      x: { label: "dot" },
      y: { label: "frames", low: 0, format: (v) => fixed(v, 0) },
      series: [
        { name: "found", color: "var(--c0)", line: false, points: of((p) => p.facing_views) },
        {
          name: "in which it faces the camera",
          color: "var(--c1)",
          line: false,
          r: 2.2,
          points: of((p) => p.facing_frames),
        },
      ],
      note: "Few frames: turn the ball so that this dot faces the camera, and film again. Facing but not found: the dot is missing or hidden.",
    }),
    curves({
      title: "How well each dot is known",
      x: { label: "dot" },
      y: { label: "standard deviation [deg]", low: 0, format: (v) => fixed(v, 2) },
      series: [
        {
          name: "per tangent axis",
          color: "var(--c0)",
          line: false,
          points: d.dots
            .filter((p) => p.state !== "missing")
            .map((p) => ({ x: p.nominal_number, y: p.sigma_deg })),
        },
        {
          name: "more views are needed above",
          color: "var(--seam)",
          marks: false,
          silent: true,
          dashed: true,
          points: [0, d.dots.length - 1].map((x) => ({ x, y: d.well_measured_deg })),
        },
      ],
    }),
  );
  section("coverage", "Coverage", null).append(charts);
}

/** Before and after; of a pattern that is built from the clip only after. */
const own = (d, values) => (isDesign(d) ? values : values.slice(-1));

function residualSection(d) {
  const h = d.held_out,
    node = section(
      "residuals",
      isDesign(d) ? "Is it better?" : "How well it fits",
      `Frames that took no part: the clip is dealt into ${h.folds} folds, and each is identified with ${isDesign(d) ? "the nominal table and with " : ""}a calibration from the others. Residual: the angle between a detected dot and where the orientation puts it, root mean square of a frame's dots; the noise of a dot below is per axis, some 0.7 times as much.`,
    );
  if (!h.frames.length) {
    node.append(el("p", { text: "Too few frames to judge the calibration on others." }));
    return;
  }
  const series = (name, color, side) => ({
    name,
    color,
    line: false,
    points: h.frames
      .filter((f) => f[side])
      .map((f) => ({ x: f.frame, y: f[side].residual_deg, note: `${f[side].matched} dots` })),
  });
  node.append(
    curves({
      title: "Residual of each frame",
      x: { label: "frame", format: (v) => fixed(v, 0) },
      y: { label: "rms residual [deg]", low: 0, format: (v) => fixed(v, 2) },
      series: [
        ...(isDesign(d) ? [series("nominal table", "var(--c1)", "before")] : []),
        series("its own table", "var(--c0)", "after"),
      ],
    }),
    table(
      isDesign(d) ? ["", "nominal table", "its own table"] : ["", "its own table"],
      [
        ["median residual", ...own(d, h.median_deg).map((v) => fixed(v, 2) + "\u00b0")],
        ["dots identified a frame", ...own(d, h.mean_matched).map((v) => fixed(v, 1))],
        ...(d.motion
          ? [
              [
                "median distance off one spin",
                ...own(d, d.motion).map((m) => fixed(m.median_deg, 2) + "\u00b0"),
              ],
              ["frames that agree with the spin", ...own(d, d.motion).map((m) => String(m.frames))],
            ]
          : []),
      ],
    ),
  );
}

function worthSection(d) {
  const trials = d.monte_carlo[0].nominal.samples,
    kinds = [
      ...(isDesign(d)
        ? [
            ["nominal", "drawn exactly", "var(--c2)"],
            ["drawn_uncalibrated", "this ball, nominal table", "var(--c1)"],
          ]
        : []),
      ["drawn_calibrated", "this ball, its own table", "var(--c0)"],
    ];
  section(
    "rates",
    isDesign(d) ? "Is it worth drawing again?" : "How often it is answered right",
    `${trials.toLocaleString("en")} simulated views per row${isDesign(d) ? ", the same rotations and noise for all three" : ""} (seed ${d.seed}). A view fails when it shows too few dots, or when the orientation is not found within 20\u00b0.`,
  ).append(
    failures({
      title: `Views not answered right, ${RECOGNIZERS.robust}`,
      label: "of the views fail",
      series: kinds.map(([, name, color]) => ({ name, color })),
      groups: d.monte_carlo.map((m) => ({
        name: (PROTOCOLS[m.protocol] || [m.protocol])[0],
        what: (PROTOCOLS[m.protocol] || [])[1],
        rates: kinds.map(([key]) => success(m[key])),
      })),
      note: "The axis is a square root, so that small rates and zero can both be seen.",
    }),
    table(
      ["mean orientation error", ...kinds.map(([, name]) => name)],
      d.monte_carlo.map((m) => [
        m.protocol,
        ...kinds.map(([key]) => fixed(m[key].mean_error_deg, 2) + "\u00b0"),
      ]),
    ),
  );
}

function drawnDots(d, ball) {
  const designed = isDesign(d);
  const made = table(
    [
      "dot",
      "state",
      ...(designed ? ["number now", "offset", "north", "east"] : ["mark"]),
      "sigma",
      "frames",
      "facing",
    ],
    d.dots.map((p, i) => {
      const angle = (v) => (isSeen(p) ? fixed(v, 2) + "\u00b0" : "\u2013"),
        number = (n) => (Number.isInteger(n) ? String(n) : "\u2013");
      return [
        String(p.nominal_number),
        p.state,
        ...(designed
          ? [number(p.number), angle(p.offset_deg), ...d.compass_deg[i].map(angle)]
          : [number(p.mark)]),
        p.state === "missing" ? "\u2013" : fixed(p.sigma_deg, 2) + "\u00b0",
        String(p.views),
        `${p.facing_views} of ${p.facing_frames}`,
      ];
    }),
  );
  [...made.querySelectorAll("tbody tr")].forEach((row, i) => {
    row.dataset.dot = i;
    row.addEventListener("click", () => ball.choose(i, true));
  });
  section(
    "dots",
    "The dots",
    (designed
      ? "The same values are in offsets.csv."
      : "Dots are numbered as in pattern.csv and dots.png. Marks are numbered as in marks.png, by their likeness to a dot and before it is known which of them are dots: use these numbers with --marks only.") +
      " frames: those that show the dot; facing: of those in which it faces the camera well, how many show it.",
  ).append(made);
}

/** A mark as marks.png has it. */
const markName = (mark) => (Number.isInteger(mark.mark) ? `mark ${mark.mark}` : "mark");

function markSection(d) {
  section(
    "marks",
    "Marks that the pattern lacks",
    "Steady on the ball, found where no dot is: a logo's corner, a stain.",
  ).append(
    table(
      ["mark", "direction", "found in", "taken in as"],
      d.marks.map((m) => [
        Number.isInteger(m.mark) ? String(m.mark) : "\u2013",
        `(${m.direction.map((c) => fixed(c, 3)).join(", ")})`,
        `${m.found} of ${m.views} views`,
        m.number === null ? "left out" : `dot ${m.number}`,
      ]),
    ),
  );
}
