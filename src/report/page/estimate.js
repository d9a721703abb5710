// The page of an estimate, for each ball: the ball as seen, its orientation over time, its spin, rejected frames.

function estimatePage(page) {
  if (!page.balls.length) MAIN.append(el("p", { class: "notice", text: "No ball was found." }));
  for (const d of page.balls) {
    if (d.number !== null) beginPart(`ball-${d.number}-`, `Ball ${d.number}`);
    ballPart(d);
  }
}

function ballPart(d) {
  const found = d.frames.filter((f) => f.orientation_wxyz);
  const row = [tile(`${found.length} of ${d.frames.length}`, "frames with an orientation")];
  if (d.spin) {
    row.push(
      tile(
        spinWords(d),
        "spin, with its standard deviation",
      ),
      tile(fixed(d.spin.sigma_deg, 2) + "\u00b0", "noise of an orientation per axis"),
      tile(`${d.spin.inliers} of ${found.length}`, "orientations agree with the spin"),
    );
  } else if (d.spin_rejection) row.push(tile("no spin", d.spin_rejection));
  tileRow(...row);
  turningBall(d);
  if (d.spin) spinSection(d);
  overTime(d);
  rejected(d);
  gallery(d);
}

/** The spin with as many digits as on the terminal; of a golf ball in turns a minute. */
function spinWords(d) {
  const [unit, by, digits] = d.is_golf ? ["rpm", 60, 0] : ["rps", 1, 3],
    std = d.spin.std_rps ? " \u00b1 " + fixed(by * d.spin.std_rps, digits) : "";
  return `${fixed(by * d.spin.rps, digits)}${std} ${unit}`;
}

/** What is known of a frame's pose: how well it agrees with the paint, or the dots that say it. */
const poseWords = (f) =>
  f.agreement === null
    ? `confidence ${percent(f.confidence)}, ${f.matched} of ${f.dots} dots, residual ${fixed(f.residual_deg, 2)}\u00b0`
    : `agreement with the surface ${fixed(f.agreement, 2)}`;
const shortWords = (f) =>
  f.agreement === null
    ? `p\u00a0=\u00a0${fixed(f.confidence, 2)}, ${f.matched}\u00a0of\u00a0${f.dots}\u00a0dots`
    : `agreement\u00a0${fixed(f.agreement, 2)}`;

/** A time as one after the first frame's. */
const since = (d, time) => `${fixed(1e3 * (time - (d.frames[0].time_s ?? 0)), 2)} ms after the first frame`;

/** A turn by a rotation vector. */
function turned(vector) {
  const angle = Math.hypot(...vector);
  return angle > 0
    ? rotation(
        vector.map((c) => c / angle),
        angle,
      )
    : IDENTITY;
}

/** The orientation that a spin predicts at a time: exp(p tau) R exp(q tau), q fixed in the ball, on the clock of its decay. */
function predicted(spin, time) {
  if (spin.over_time) return predictedFree(spin.over_time, time);
  const start = fromQuaternion(spin.orientation_wxyz),
    c = spin.decay_per_s,
    t = time - spin.time_s,
    tau = c ? -Math.expm1(-c * t) / c : t,
    q = spin.body_rate_rad_s,
    u = spin.axis,
    along = times(start, q).reduce((sum, x, i) => sum + x * u[i], 0),
    p = spin.spin_rad_s.map((x, i) => x - u[i] * along);
  return multiply(
    multiply(turned(p.map((x) => x * tau)), start),
    turned(q.map((x) => x * tau)),
  );
}
/** The same of a free motion: between two times the spin is a straight line. */
function predictedFree(knots, time) {
  const after = knots.findIndex((k) => k.time_s > time),
    at = after < 0 ? knots.length - 1 : Math.max(0, after - 1),
    a = knots[at],
    start = fromQuaternion(a.orientation_wxyz);
  if (after <= 0) return multiply(turned(a.spin_rad_s.map((c) => c * (time - a.time_s))), start);
  const b = knots[after],
    dt = b.time_s - a.time_s,
    share = (time - a.time_s) / dt,
    mean = a.spin_rad_s.map((c, i) => c + 0.5 * share * (b.spin_rad_s[i] - c));
  return multiply(turned(mean.map((c) => c * share * dt)), start);
}
const apart = (a, b) => {
  const m = multiply(a, transpose(b));
  return Math.acos(Math.max(-1, Math.min(1, (m[0] + m[4] + m[8] - 1) / 2))) / DEG;
};

function turningBall(d) {
  const node = section(
    "ball",
    "The ball",
    "As the camera sees it: x right, y up, z towards the camera." +
      (d.paint
        ? ` Its paint is as the frames show it, in the frame of its surface; striped: ${percent(1 - d.paint.known)} of the ball, which none shows.`
        : ""),
    "The slider goes through the frames; drag the ball to look at it from elsewhere.",
  );
  const state = {
      k: Math.max(
        0,
        d.frames.findIndex((f) => f.orientation_wxyz),
      ),
    },
    words = el("pre", { "aria-live": "polite" }),
    picture = el("div", { class: "stage" });
  const view = new View("The ball as estimated. Arrow keys turn it.", (v) => {
    const f = d.frames[state.k],
      turn = f.orientation_wxyz
        ? fromQuaternion(f.orientation_wxyz)
        : d.spin && f.time_s !== null
          ? predicted(d.spin, f.time_s)
          : null;
    if (!turn)
      return {
        reach: 1.35,
        ball: null,
        labels: [{ at: [0, 0, 0], text: "no orientation", color: "--bad", size: 16 }],
        lines: [],
      };
    const ball = {
      center: [0, 0, 0],
      radius: 1,
      turn,
      dots: d.dots,
      dotAngle: d.dot_angle_rad,
      zones: d.keep_out,
      chosen: -1,
      paint: d.paint,
    };
    const axes = tripod(v, IDENTITY, 1.35),
      lines = axes.lines,
      labels = dotLabels(v, ball, 1.35).concat(axes.labels);
    if (d.spin && d.spin.rps > 0) {
      const n = d.spin.axis,
        seen = times(v.turn, n),
        side = Math.hypot(seen[0], seen[1]) || 1,
        out = seen[2] >= 0;
      for (const [from, to] of [
        [1.0, 1.27],
        [-1.27, -1.0],
      ])
        if (from > 0 === out || Math.abs(seen[2]) < 0.999)
          lines.push({
            from: n.map((c) => c * from),
            to: n.map((c) => c * to),
            color: "--seam",
            width: 4,
          });
      labels.push({
        at: n.map((c) => c * 1.27),
        text: "\u03c9",
        color: "--seam",
        size: 17,
        offset: [(12 * seen[0]) / side, (-12 * seen[1]) / side],
      });
    }
    return { reach: 1.35, ball, lines, labels };
  });
  const slider = el("input", {
    type: "range",
    min: 0,
    max: d.frames.length - 1,
    value: state.k,
    "aria-label": "Frame",
    oninput: () => show(Number(slider.value)),
  });
  const show = (k) => {
    state.k = k;
    slider.value = k;
    const f = d.frames[k];
    words.textContent = [
      `frame ${f.name}`,
      f.time_s === null
        ? "no time"
        : since(d, f.time_s),
      f.rejection ? `rejected: ${f.rejection}` : poseWords(f),
    ].join("\n");
    picture.replaceChildren(
      f.picture
        ? el("img", { src: f.picture, alt: `Frame ${f.name} with ${d.paint ? "its paint's borders" : "its detections"}` })
        : el("p", { class: "notice", text: "No picture of this frame is in this page." }),
    );
    view.draw();
  };
  let playing = null;
  const play = el("button", {
    type: "button",
    text: "Play",
    onclick: () => {
      if (playing) {
        clearInterval(playing);
        playing = null;
        play.textContent = "Play";
        return;
      }
      play.textContent = "Stop";
      playing = setInterval(() => show((state.k + 1) % d.frames.length), 120);
    },
  });
  node.append(
    turnable(view, {
      controls: [
        play,
        slider,
        el("button", { type: "button", text: "Camera's view", onclick: () => view.reset() }),
      ],
      beside: [picture, words],
    }),
  );
  show(state.k);
}

const FRAMES = {
  camera: "Camera frame",
  view: "View frame (no camera is known: its z points from the ball to the camera)",
};

function spinSection(d) {
  const s = d.spin,
    node = section(
      "spin",
      "The spin",
      `${FRAMES[d.camera_frame]}, right-hand rule: a positive component turns counter-clockwise seen from that axis' tip. ` +
        (s.over_time
          ? `The ball is pushed: the motion is free, and the spin is its mean over the time.`
          : `The motion is ${s.motion}; the spin is that ${since(d, s.time_s)}.`) +
        (s.lack_of_fit
          ? ` Parts of the sequence differ ${fixed(Math.sqrt(s.lack_of_fit), 1)} times as much as their noise explains; the deviations count it.`
          : ""),
    );
  const plus = (x, e) =>
    fixed(x, 3) + (e === undefined || e === null ? "" : " \u00b1\u00a0" + fixed(e, 3));
  node.append(
    table(
      ["", "x", "y", "z", "magnitude"],
      [
        [
          "spin [rad/s]",
          ...s.spin_rad_s.map((c, i) => plus(c, s.std_rad_s?.[i])),
          plus(2 * Math.PI * s.rps, s.std_rps && 2 * Math.PI * s.std_rps),
        ],
        [
          "spin [rps]",
          ...s.spin_rad_s.map((c, i) =>
            plus(c / 2 / Math.PI, s.std_rad_s && s.std_rad_s[i] / 2 / Math.PI),
          ),
          plus(s.rps, s.std_rps),
        ],
        ...(d.is_golf
          ? [
              [
                "spin [rpm]",
                ...s.spin_rad_s.map((c) => fixed((60 * c) / 2 / Math.PI, 0)),
                fixed(60 * s.rps, 0),
              ],
            ]
          : []),
        ["axis", ...s.axis.map((c) => fixed(c, 4)), "1"],
      ],
      { class: "wraps" },
    ),
  );
  if (s.over_time)
    node.append(
      curves({
        title: "Spin over time",
        x: { label: "time [ms]" },
        y: { label: "spin [rps]", low: 0 },
        series: [
          { name: "spin", color: "var(--c0)", marks: false, f: (k) => k.rps },
          { name: "95 % band", color: "var(--c1)", marks: false, f: (k) => k.rps + 1.96 * k.std_rps },
          {
            name: "",
            color: "var(--c1)",
            marks: false,
            silent: true,
            f: (k) => Math.max(0, k.rps - 1.96 * k.std_rps),
          },
        ].map(({ f, ...line }) => ({
          ...line,
          points: s.over_time.map((k) => ({ x: 1e3 * (k.time_s - s.over_time[0].time_s), y: f(k) })),
        })),
      }),
    );
  if (s.alternatives.length)
    node.append(
      el("h3", { text: "Other spins that these times cannot distinguish from it" }),
      table(
        ["rps", "axis", "log-likelihood ratio"],
        s.alternatives
          .slice(0, 12)
          .map((a) => [
            fixed(a.rps, 3),
            `(${a.axis.map((c) => fixed(c, 3)).join(", ")})`,
            fixed(a.log_likelihood_ratio, 2),
          ]),
      ),
    );
  else
    node.append(
      el("p", { text: "No other spin in the range searched explains the orientations as well." }),
    );
}

function overTime(d) {
  const timed = d.frames.filter((f) => f.time_s !== null && f.orientation_wxyz);
  if (timed.length < 2) return;
  const node = section("time", "Over time", null),
    t0 = d.frames[0].time_s,
    ms = (f) => 1e3 * (f.time_s - t0),
    charts = el("div", { class: "two" });
  const columns = timed.map((f) => {
    const m = fromQuaternion(f.orientation_wxyz);
    return { x: ms(f), m };
  });
  ["x", "y", "z"].forEach((name, j) => {
    const series = [0, 1, 2].map((i) => ({
      name: `to ${d.camera_frame} ` + "xyz"[i],
      color: `var(--c${i})`,
      line: false,
      points: columns.map(({ x, m }) => ({ x, y: m[3 * i + j] })),
    }));
    if (d.spin)
      [0, 1, 2].forEach((i) => {
        const last = d.frames.length - 1,
          end = d.frames[last].time_s,
          n = Math.min(600, Math.max(60, Math.ceil((end - t0) * d.spin.rps * 40)));
        series.push({
          name: "",
          color: `var(--c${i})`,
          marks: false,
          silent: true,
          points: Array.from({ length: n + 1 }, (_, k) => {
            const t = t0 + ((end - t0) * k) / n;
            return { x: 1e3 * (t - t0), y: predicted(d.spin, t)[3 * i + j] };
          }),
        });
      });
    charts.append(
      curves({
        title: `Where the ${d.paint ? "surface" : "pattern"}'s ${name} axis points`,
        x: { label: "time [ms]" },
        y: { label: "component", low: -1, high: 1, format: (v) => fixed(v, 1) },
        series,
        note: d.spin
          ? "Points: estimated orientations. Lines: the spin's prediction."
          : "Points: estimated orientations.",
      }),
    );
  });
  if (d.spin)
    charts.append(
      curves({
        title: "Distance from the spin's prediction",
        x: { label: "time [ms]" },
        y: { label: "angle [deg]", low: 0 },
        series: [
          {
            name: "frames",
            color: "var(--c0)",
            line: false,
            points: timed.map((f) => ({
              x: ms(f),
              y: apart(fromQuaternion(f.orientation_wxyz), predicted(d.spin, f.time_s)),
              note: f.name,
            })),
          },
        ],
      }),
    );
  const [title, label, value] = d.paint
    ? ["Agreement with the surface", "correlation", "agreement"]
    : ["Probability that the orientation is correct", "confidence", "confidence"];
  charts.append(
    curves({
      title,
      x: { label: "time [ms]" },
      y: {
        label,
        low: 0,
        high: 1,
        ...(d.paint ? { format: (v) => fixed(v, 2) } : { format: percent, tick: wholePercent }),
      },
      series: [
        {
          name: "frames",
          color: "var(--c2)",
          line: false,
          points: timed.map((f) => ({ x: ms(f), y: f[value], note: f.name })),
        },
      ],
    }),
  );
  node.append(charts);
}

function rejected(d) {
  const by = new Map();
  for (const f of d.frames)
    if (f.rejection) by.set(f.rejection_kind, [...(by.get(f.rejection_kind) || []), f]);
  const node = section("rejected", "Rejected frames", null);
  if (!by.size) {
    node.append(el("p", { text: "None: every frame has an orientation." }));
    return;
  }
  node.append(
    table(
      ["reason", "frames", "which"],
      [...by]
        .sort((a, b) => b[1].length - a[1].length)
        .map(([reason, of]) => [
          reason,
          String(of.length),
          of
            .slice(0, 12)
            .map((f) => f.name)
            .join(", ") + (of.length > 12 ? ", \u2026" : ""),
        ]),
    ),
  );
}

/** Width and height of a PNG in a data URI, from its header: they keep its place until it is loaded. */
function pngSize(uri) {
  const header = atob(uri.slice(uri.indexOf(",") + 1, uri.indexOf(",") + 33)),
    at = (k) => [0, 1, 2, 3].reduce((n, i) => n * 256 + header.charCodeAt(k + i), 0);
  return { width: at(16), height: at(20) };
}

function gallery(d) {
  const shown = d.frames.filter((f) => f.picture);
  if (!shown.length) return;
  const node = section(
    "frames",
    "Frames",
    `${shown.length} of ${d.frames.length} frames${shown.length < d.frames.length ? ", evenly chosen: more would make this page too large" : ""}. Green: outline. ${d.paint ? "Yellow lines: where the orientation expects the borders of the paint." : "Blue: identified dots, red: others. Yellow crosses: where the orientation expects dots."}`,
  );
  node.append(
    el(
      "div",
      { class: "frames" },
      ...shown.map((f) =>
        el(
          "figure",
          { class: f.rejection ? "bad" : null },
          el("img", {
            src: f.picture,
            loading: "lazy",
            alt: `Frame ${f.name}`,
            ...pngSize(f.picture),
          }),
          el("figcaption", {
            text: `${f.name}: ${f.rejection || shortWords(f)}`,
          }),
        ),
      ),
    ),
  );
}
