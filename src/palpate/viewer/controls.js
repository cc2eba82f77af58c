// Keys, clicks on plots and in the list of touches, which viser's elements do not tell: they are written into a text
// field of the panel that nobody sees, and the server reads them there. It runs as the handler of an element, in which
// addEventListener alone would be that of the element.
(() => {
  if (window.palpateAsks) return;
  window.palpateAsks = true;
  let count = 0, down = [0, 0];
  const field = () => {
    const label = [...document.querySelectorAll("label")].find((each) => each.textContent === "palpate asks");
    let row = label;
    while (row && !row.querySelector("input")) row = row.parentElement;
    if (row) row.style.display = "none";
    return row && row.querySelector("input");
  };
  const ask = (what) => {
    const box = field();
    if (!box) return;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(box, `${++count} ${what}`);
    box.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const keys = { " ": "play", ArrowRight: "touch 1", ArrowLeft: "touch -1" };
  window.addEventListener("keydown", (event) => {
    const at = event.target, what = keys[event.key];
    if (!what || event.ctrlKey || event.metaKey || event.altKey) return;
    if (at.closest && at.closest("input:not([type=checkbox]), textarea, select, [role=slider], [contenteditable]")) return;
    if (event.key === " " && at.closest && at.closest("button, a, input")) return;  // reached by Tab: see below
    event.preventDefault();
    event.stopImmediatePropagation();
    ask(event.shiftKey ? what.replace("touch", "sample") : what);
  }, true);
  window.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; }, true);
  window.addEventListener("click", (event) => {
    const at = event.target.closest ? event.target : document.body;
    const button = at.closest("button, input[type=checkbox]");
    if (event.detail && button) button.blur();  // clicked by a pointer: keys are the page's again
    const row = at.closest("[data-asks]");
    if (row) return ask(row.dataset.asks);
    const over = at.closest(".u-over");
    if (!over || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 4) return;  // dragged: viser zooms
    const charts = Object.values((window.__viserTestpoints || {}).uplots || {}).map((each) => each.chart);
    const chart = charts.find((each) => each.over === over);
    if (chart) ask(`seek ${chart.posToVal(event.clientX - over.getBoundingClientRect().left, "x")}`);
  }, true);
  new MutationObserver(field).observe(document.body, { childList: true, subtree: true });
  field();
})();
