"use strict";
// One formulation may be lit; charts and tables then dim the others.
let lit = null;

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// ---- Charts ---------------------------------------------------------------------------------------

const charts = [...document.querySelectorAll(".chart")].map((figure) => ({
  plot: figure.querySelector(".plot"),
  selects: [...figure.querySelectorAll("select")],
  figures: JSON.parse(figure.querySelector("script").textContent),
}));

function styled(trace) {
  const key = trace.meta.formulation;
  const color = css(`--f-${key}`);
  return {
    ...trace,
    opacity: lit === null || lit === key ? 1 : 0.1,
    line: { ...trace.line, color, width: lit === key ? 3 : 1.6 },
    marker: { ...trace.marker, color },
  };
}

function layoutOf(layout) {
  const axis = (given) => ({
    ...given,
    gridcolor: css("--line"),
    linecolor: css("--line"),
    zeroline: false,
  });
  return {
    ...layout,
    xaxis: axis(layout.xaxis),
    yaxis: axis(layout.yaxis),
    paper_bgcolor: css("--back"),
    plot_bgcolor: css("--back"),
    font: { color: css("--text"), size: 13 },
    hoverlabel: {
      bgcolor: css("--raised"),
      bordercolor: css("--line"),
      font: { color: css("--text"), size: 12 },
      align: "left",
    },
  };
}

function draw(chart) {
  const chosen = chart.selects.map((select) => select.value).join("\n");
  // Not everything that can be chosen goes together.
  const { data, layout } = chart.figures[chosen] ?? { data: [], layout: {} };
  const options = { responsive: true, displayModeBar: false };
  // The one that is lit is drawn last, above the others.
  const order = [...data].sort((a, b) => (a.name === lit) - (b.name === lit));
  Plotly.react(chart.plot, order.map(styled), layoutOf(layout), options);
}

const drawAll = () => charts.forEach(draw);
for (const chart of charts) {
  for (const select of chart.selects) select.addEventListener("change", () => draw(chart));
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
drawAll();

// ---- Legend ---------------------------------------------------------------------------------------

const buttons = [...document.querySelectorAll("#legend button")];

function light(key) {
  lit = lit === key ? null : key;
  const known = buttons.map((button) => button.dataset.key);
  for (const button of buttons) {
    button.setAttribute("aria-pressed", String(button.dataset.key === lit));
  }
  for (const marked of document.querySelectorAll("[data-f]")) {
    const other = known.includes(marked.dataset.f) && marked.dataset.f !== lit;
    marked.classList.toggle("dim", lit !== null && other);
  }
  drawAll();
}
for (const button of buttons) button.addEventListener("click", () => light(button.dataset.key));

// ---- Links into what is folded ---------------------------------------------------------------------

function unfold() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target instanceof HTMLDetailsElement) {
    target.open = true;
    target.scrollIntoView();
  }
}
addEventListener("hashchange", unfold);
unfold();

// ---- The section that is read -----------------------------------------------------------------------

const links = [...document.querySelectorAll(".contents a")];
const sections = links.map((link) => document.querySelector(link.hash));

function markSection() {
  // One that begins in the upper third is read; at the end of the page it is the last.
  const end = scrollY + innerHeight >= document.documentElement.scrollHeight - 2;
  const passed = sections.filter((one) => end || one.getBoundingClientRect().top <= innerHeight / 3);
  const current = links[passed.length - 1];
  for (const link of links) {
    if (link !== current) link.removeAttribute("aria-current");
    else if (!link.hasAttribute("aria-current")) {
      link.setAttribute("aria-current", "true");
      const row = link.parentElement;
      row.scrollLeft = link.offsetLeft - (row.clientWidth - link.offsetWidth) / 2;
    }
  }
}
addEventListener("scroll", markSection, { passive: true });
markSection();
