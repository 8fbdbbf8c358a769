"use strict";
// Mechanisms that are turned by hand. `startViewers(load)` draws each `.viewer` when it comes into
// sight; `load` returns a promise of plotly. Without this script a viewer shows what it holds else.
// A browser has room for about sixteen of them at once: those out of sight make room for others.

function startViewers(load) {
  const ground = () => {
    for (let at = document.body; at; at = at.parentElement) {
      const color = getComputedStyle(at).backgroundColor;
      const parts = (color.match(/[\d.]+/g) ?? []).map(Number);
      if (parts.length >= 3 && parts[3] !== 0) return { color, parts };
    }
    return { color: "rgb(255, 255, 255)", parts: [255, 255, 255] };
  };
  const isDark = () => ground().parts.slice(0, 3).reduce((a, b) => a + b, 0) < 384;

  class Viewer {
    constructor(figure) {
      this.element = figure;
      this.content = JSON.parse(figure.querySelector("script").textContent);
      this.hidden = new Set(["names"]);
      this.pose = 0;
      this.plot = figure.querySelector(".turned");
      this.controls = figure.querySelector(".controls");
      figure.classList.add("live");
    }

    styled(trace) {
      const { color, fill, group } = trace.meta;
      const palette = { ...this.content.colors[isDark() ? "dark" : "light"], ground: ground().color };
      const made = { ...trace, visible: !this.hidden.has(group) };
      if (this.pose) {
        const all = this.content.figure.data.indexOf(trace);
        [made.x, made.y, made.z] = this.content.poses[this.pose][all];
      }
      if (trace.type === "mesh3d") made.color = palette[color];
      else if (trace.mode === "lines") made.line = { ...trace.line, color: palette[color] };
      else if (trace.mode === "text") made.textfont = { ...trace.textfont, color: palette[color] };
      else {
        const line = { ...trace.marker.line, color: palette[color] };
        made.marker = { ...trace.marker, color: palette[fill], line };
      }
      return made;
    }

    draw() {
      const { data, layout } = this.content.figure;
      const camera = this.camera();
      const scene = { ...layout.scene, ...(camera && { camera }) };
      const ground = { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)" };
      const options = { responsive: true, displayModeBar: false, scrollZoom: false };
      const made = data.map((trace) => this.styled(trace));
      return Plotly.react(this.plot, made, { ...layout, ...ground, scene }, options);
    }

    camera() {
      return this.plot._fullLayout?.scene?._scene?.getCamera() ?? this.turned;
    }

    // Give the place in the graphics card back; `draw` takes it again.
    retire() {
      this.turned = this.camera();
      Plotly.purge(this.plot);
    }

    // Checkboxes of what is there, and for a motion its time and a button that plays it.
    control() {
      const { figure, times, poses, scale } = this.content;
      const digits = (x, unit) => `${Number(x.toPrecision(3))} ${unit}`;
      const names = {
        names: "names",
        velocity: `velocities, up to ${digits(scale.velocity, "m/s")}`,
        force: `constraint forces, up to ${digits(scale.force, "N")}`,
      };
      const there = new Set(figure.data.map((trace) => trace.meta.group));
      for (const [group, text] of Object.entries(names)) {
        if (!there.has(group)) continue;
        const label = document.createElement("label");
        const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: !this.hidden.has(group) });
        box.addEventListener("change", () => {
          this.hidden[box.checked ? "delete" : "add"](group);
          this.draw();
        });
        const words = Object.assign(document.createElement("span"), { textContent: text });
        words.dataset.group = group;
        label.append(box, " ", words);
        this.controls.append(label);
      }
      if (!poses.length) return;
      const button = Object.assign(document.createElement("button"), { type: "button" });
      const range = Object.assign(document.createElement("input"), { type: "range", min: 0, value: 0 });
      const output = document.createElement("output");
      range.max = times.length - 1;
      range.setAttribute("aria-label", "time");
      const last = times[times.length - 1];
      const show = (pose) => {
        this.pose = pose;
        range.value = pose;
        output.textContent = `t = ${times[pose].toFixed(Math.max(0, 2 - Math.floor(Math.log10(last))))} s`;
        return this.draw();
      };
      let timer = null;
      const stop = () => {
        clearInterval(timer);
        timer = null;
        button.textContent = "play";
      };
      button.addEventListener("click", () => {
        if (timer !== null) return stop();
        button.textContent = "stop";
        if (this.pose === times.length - 1) show(0);
        timer = setInterval(() => {
          if (this.pose === times.length - 1) stop();
          else show(this.pose + 1);
        }, 100);
      });
      range.addEventListener("input", () => (stop(), show(Number(range.value))));
      stop();
      const motion = Object.assign(document.createElement("div"), { className: "motion" });
      motion.append(button, range, output);
      this.controls.append(motion);
      output.textContent = `t = ${times[0]} s`;
    }
  }

  const webgl = () => Boolean(document.createElement("canvas").getContext("webgl"));
  const figures = [...document.querySelectorAll(".viewer")];
  if (!figures.length || !webgl()) return;
  const made = new Map();
  const shown = new Set();
  const inSight = new Set();
  const MOST = 8;
  const show = (figure) => {
    if (!made.has(figure)) {
      made.set(figure, new Viewer(figure));
      made.get(figure).control();
    }
    shown.add(figure);
    for (const other of [...shown].filter((one) => !inSight.has(one))) {
      if (shown.size <= MOST) break;
      made.get(other).retire();
      shown.delete(other);
    }
    return made.get(figure).draw();
  };
  const seen = new IntersectionObserver(
    (entries) => {
      for (const { target, isIntersecting } of entries) {
        inSight[isIntersecting ? "add" : "delete"](target);
        if (isIntersecting && !shown.has(target)) load().then(() => show(target));
      }
    },
    { rootMargin: "300px" },
  );
  figures.forEach((figure) => seen.observe(figure));
  const redraw = () => shown.forEach((figure) => made.get(figure).draw());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  new MutationObserver(redraw).observe(document.body, { attributeFilter: ["data-theme"] });
}
