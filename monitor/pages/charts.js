"use strict";
// Bokeh figures of a page: read at once, made when they come near, all of them before printing.
const Charts = (() => {
  const finger = matchMedia("(pointer: coarse)").matches;
  const clock = (seconds) => {
    const whole = Math.round(Math.abs(seconds));
    const two = (number) => String(number).padStart(2, "0");
    const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
    const text = hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
    return seconds <= -0.5 ? `-${text}` : text;
  };
  // Time axes: m:ss instead of h:mm:ss throughout, which is what Bokeh's own format gives.
  const shortenTimes = () => {
    const formatter = Bokeh.Models.get("NumeralTickFormatter").prototype;
    const usual = formatter.doFormat;
    formatter.doFormat = function (ticks, options) {
      return this.format === "00:00:00" ? ticks.map(clock) : usual.call(this, ticks, options);
    };
  };
  // What Bokeh builds beside its canvases takes the page's colours too; each view has a shadow root of its own.
  const dress = (module, view, css) => {
    const { prototype } = Bokeh.require(module)[view];
    const usual = prototype.stylesheets;
    prototype.stylesheets = function () { return [...usual.call(this), css]; };
  };
  const dressAll = () => {
    dress("models/tools/toolbar", "ToolbarView", `
      .bk-divider { background-color: var(--line) !important; }
      @media print { :host { visibility: hidden; } }`);
    dress("models/ui/tooltip", "TooltipView", `
      :host { --tooltip-color: var(--paper); --tooltip-text: var(--ink); --tooltip-border: var(--soft);
        --tooltip-arrow-color: var(--soft); max-width: min(26rem, 90vw); padding: 6px 9px; border-radius: 4px; opacity: 1; }
      .bk-tooltip-row-label { color: var(--soft); white-space: nowrap; padding-right: 6px; vertical-align: top; }`);
  };
  // Under a finger a chart is part of the page: dragging scrolls, until the pan tool is switched on.
  const letScroll = (model) => {
    for (const one of model.references?.() ?? [model]) {
      if (one.type === "Toolbar") one.setv({ active_drag: null, active_scroll: null });
    }
  };

  // Makes the charts of one document: {doc: Bokeh's JSON}; each element with data-root shows that root.
  const open = async (json) => {
    shortenTimes();
    dressAll();
    const { Document } = Bokeh.require("document");
    const doc = Document.from_json(json);
    Theme.follow(doc);
    const roots = new Map(doc.roots().map((model) => [model.id, model]));
    const waiting = new Map();
    for (const element of document.querySelectorAll("[data-root]")) {
      const model = roots.get(element.dataset.root);
      if (model) waiting.set(element, model);
    }
    const make = async (element) => {
      const model = waiting.get(element);
      if (!model) return;
      waiting.delete(element);
      if (finger) letScroll(model);
      const view = await Bokeh.index.build_view(model);
      view.build(element);
      element.dataset.made = "";
    };
    const all = () => Promise.all([...waiting.keys()].map(make));
    const near = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        near.unobserve(entry.target);
        void make(entry.target);
      }
    }, { rootMargin: "100% 0px" });
    const inSight = [];
    for (const element of waiting.keys()) {
      if (element.getBoundingClientRect().top < innerHeight) inSight.push(element);
      else near.observe(element);
    }
    await Promise.all(inSight.map(make));
    performance.mark("charts in sight");
    // The rest while nothing else is to do, so that print and find-in-page have them.
    const idle = window.requestIdleCallback ?? ((task) => setTimeout(task, 50));
    const next = () => {
      const [element] = waiting.keys();
      if (element) void make(element).then(() => idle(next));
      else performance.mark("all charts");
    };
    idle(next);
    addEventListener("beforeprint", () => void all());
    return { doc, all };
  };
  return { clock, open };
})();
