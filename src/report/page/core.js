// What every page uses: elements, numbers in words, the theme, the tip, small linear algebra.

const DATA = JSON.parse(document.getElementById("data").textContent);
const MAIN = document.getElementById("main");
const TIP = document.getElementById("tip");

/** An element with attributes and children; `text` sets its text, `on...` its listeners. */
function el(name, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "line", "circle", "rect", "text", "polygon"].includes(name);
  const node = svg
    ? document.createElementNS("http://www.w3.org/2000/svg", name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key === "text") node.textContent = value;
    else if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.filter((c) => c !== null && c !== undefined));
  return node;
}

/** What the ids and titles of the sections of a part begin with. */
let PART = { id: "", title: "" };

/** Begins a part of a page: its sections stand below its title. */
function beginPart(id, title) {
  PART = { id, title: title + ": " };
  MAIN.append(el("h2", { class: "part", text: title }));
}

/** A section with its entry in the contents. `use` says how a screen is used, which paper leaves out. */
function section(name, heading, lead, use) {
  const id = PART.id + name,
    title = PART.title + heading;
  document.getElementById("contents").append(el("a", { href: "#" + id, text: title }));
  const node = el(
    "section",
    { id, "aria-labelledby": id + "-title" },
    el("h2", { id: id + "-title", text: title }),
  );
  if (lead || use)
    node.append(
      el(
        "p",
        { class: lead ? "lead" : "lead screen-only" },
        lead,
        use ? el("span", { class: "screen-only", text: (lead ? " " : "") + use }) : null,
      ),
    );
  MAIN.append(node);
  return node;
}

/** A table; columns whose first value is words are set to the left. */
function table(heads, rows, attributes = {}) {
  const wordy = heads.map(
    (_, i) => typeof rows[0]?.[i] === "string" && /[a-z]{4}/i.test(rows[0][i]),
  );
  const cells = (name, values) =>
    values.map((v, i) => el(name, { text: v, class: wordy[i] ? "words" : null }));
  const row = (name, values) => el("tr", {}, ...cells(name, values));
  return el(
    "div",
    { class: "scroll" },
    el(
      "table",
      attributes,
      el("thead", {}, row("th", heads)),
      el("tbody", {}, ...rows.map((values) => row("td", values))),
    ),
  );
}

function list(entries) {
  const node = el("dl");
  for (const [name, value] of entries)
    node.append(el("dt", { text: name }), el("dd", { text: value }));
  return node;
}

const fixed = (x, digits = 2) => {
  if (!Number.isFinite(x)) return "\u2013";
  const text = x.toFixed(digits);
  // What rounds to zero has no sign.
  return text.replace("-", Number(text) === 0 ? "" : "\u2212");
};
/** At most three significant digits. */
const short = (x) =>
  Number.isFinite(x) ? String(+x.toPrecision(3)).replace("-", "\u2212") : "\u2013";
const DEG = Math.PI / 180;

/** Decimals of a fraction in percent, enough that neither 0 nor 100 is shown for anything else. */
function decimals(rate) {
  const rest = Math.min(100 * rate, 100 - 100 * rate);
  return rest <= 0 ? 0 : Math.min(4, Math.max(1, Math.ceil(1 - Math.log10(rest))));
}
/** A fraction in percent. */
const percent = (rate, digits = decimals(rate)) => (100 * rate).toFixed(digits) + " %";
/** For ticks, which are round. */
const wholePercent = (v) => short(100 * v) + " %";
/** A rate and the ends of its interval in percent, with the same decimals. */
function percents(p) {
  const digits = Math.max(...[p.rate, p.low, p.high].map(decimals));
  return [p.rate, p.low, p.high].map((rate) => percent(rate, digits));
}
function interval(p) {
  const [rate, low, high] = percents(p);
  return `${rate} [${low.slice(0, -2)}, ${high.slice(0, -2)}]`;
}

/** The value of a color variable of the page. */
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rgb = (name) => {
  const h = css(name);
  return [1, 3, 5].map((i) => parseInt(h.slice(i, i + 2), 16) / 255);
};

/** Called when colors change, and before printing. */
const RESTYLED = [];
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  for (const redraw of RESTYLED) redraw();
}
const DARK = matchMedia("(prefers-color-scheme: dark)");
setTheme(DARK.matches ? "dark" : "light");
DARK.addEventListener("change", () => setTheme(DARK.matches ? "dark" : "light"));
document
  .getElementById("theme")
  .addEventListener("click", () =>
    setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  );
let shown = null;
addEventListener("beforeprint", () => {
  shown = document.documentElement.dataset.theme;
  setTheme("light");
});
addEventListener("afterprint", () => {
  if (shown) setTheme(shown);
  shown = null;
});

/** Shows a tip at a place of the page, in pixels; `null` hides it. */
function tip(words, x, y) {
  TIP.hidden = words === null;
  if (words === null) return;
  if (TIP.textContent !== words) TIP.textContent = words;
  const width = TIP.offsetWidth,
    room = document.documentElement.clientWidth;
  TIP.style.left = Math.max(8, Math.min(x + 14, room - width - 8)) + "px";
  TIP.style.top = y + 16 + "px";
}

// Vectors are arrays of three numbers, matrices of nine by rows.
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const times = (m, v) => [0, 3, 6].map((i) => m[i] * v[0] + m[i + 1] * v[1] + m[i + 2] * v[2]);
const multiply = (a, b) =>
  [0, 3, 6].flatMap((i) =>
    [0, 1, 2].map((j) => a[i] * b[j] + a[i + 1] * b[j + 3] + a[i + 2] * b[j + 6]),
  );
const transpose = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const angleBetween = (a, b) => Math.acos(Math.max(-1, Math.min(1, dot(a, b)))) / DEG;

/** The rotation by `angle` (radians) about a unit axis (Rodrigues). */
function rotation(axis, angle) {
  const [x, y, z] = axis,
    c = Math.cos(angle),
    s = Math.sin(angle),
    k = 1 - c;
  return [
    c + x * x * k,
    x * y * k - z * s,
    x * z * k + y * s,
    y * x * k + z * s,
    c + y * y * k,
    y * z * k - x * s,
    z * x * k - y * s,
    z * y * k + x * s,
    c + z * z * k,
  ];
}

/** The rotation of a unit quaternion, scalar first. */
function fromQuaternion([w, x, y, z]) {
  return [
    1 - 2 * (y * y + z * z),
    2 * (x * y - w * z),
    2 * (x * z + w * y),
    2 * (x * y + w * z),
    1 - 2 * (x * x + z * z),
    2 * (y * z - w * x),
    2 * (x * z - w * y),
    2 * (y * z + w * x),
    1 - 2 * (x * x + y * y),
  ];
}

/** The matrix with orthonormal rows that is nearest for small errors: Gram-Schmidt. */
function orthonormal(m) {
  const unit = (v) => {
    const n = Math.hypot(...v);
    return v.map((c) => c / n);
  };
  const a = unit(m.slice(0, 3)),
    b0 = m.slice(3, 6),
    d = dot(a, b0);
  const b = unit(b0.map((c, i) => c - d * a[i]));
  return [
    ...a,
    ...b,
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
  ];
}
