// What several pages share: tiles, a view with its controls, names of protocols, and the command.

const RECOGNIZERS = { robust: "our recognizer", voting: "the paper's recognizer" };

const PROTOCOLS = {
  paper: ["paper", "all dots in view, 3\u00b0 noise"],
  sparse: ["sparse", "four dots, 3\u00b0 noise"],
  clutter: ["clutter", "5\u00b0, a fifth missed, 2 false"],
  image: ["image", "1 px on 60 px, a tenth missed"],
};
/** What counts as success: a right orientation, of all views. */
const success = (v) => v.answered;

function tile(value, words) {
  return el("div", { class: "tile" }, el("b", { text: value }), el("span", { text: words }));
}

/** A rate as a tile, with its interval after the words. */
function rateTile(p, words) {
  const [rate, low, high] = percents(p);
  return tile(rate, `${words} (95 %: ${low.slice(0, -2)} to ${high})`);
}

/** Tiles with the values that count, at the top of a page. */
function tileRow(...tiles) {
  MAIN.append(el("div", { class: "tiles" }, ...tiles));
}

function checkbox(text, on, change) {
  const box = el("input", { type: "checkbox", onchange: () => change(box.checked) });
  box.checked = on;
  return el("label", {}, box, text);
}

/** A view to turn with its controls and caption, and what stands beside it. */
function turnable(view, { controls, caption, beside }) {
  return el(
    "div",
    { class: "pair" },
    el(
      "figure",
      {},
      view.node,
      el("div", { class: "controls screen-only" }, ...controls),
      caption ? el("figcaption", { text: caption }) : null,
    ),
    el("div", {}, ...beside),
  );
}

/** The words of a command, none of which is broken at its hyphens. */
const unbroken = (command) =>
  command.split(" ").flatMap((word, i) => [i ? " " : "", el("span", { class: "word", text: word })]);

/** How to make the page's values again: the command, where there is one, and what it used. */
function repeatable(command, without, facts) {
  section("repeat", "Repeat it", null).append(
    command ? el("pre", {}, ...unbroken(command)) : el("p", { text: without }),
    list(facts),
  );
}
