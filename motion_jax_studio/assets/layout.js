// The page's drawer, the height of its timeline, cameras with bookmarks.
import { bindClips } from "./clip_tools.js";
import { toJson } from "./motion.js";
import { stored } from "./stored.js";

const $ = (id) => document.getElementById(id);
const LOWEST = 96, // pixels of the timeline
  HIGHEST = 0.45, // share of the window
  STEP = 16,
  MOST_VIEWS = 6;

export function layOut(studio) {
  const open = (on) => {
    document.body.classList.toggle("no-drawer", !on);
    $("show-drawer").setAttribute("aria-expanded", String(on));
  };
  const kept = stored("drawer");
  open(kept ? kept === "open" : innerWidth >= 1000);
  studio.toggleDrawer = () => {
    const on = document.body.classList.contains("no-drawer");
    open(on);
    stored("drawer", on ? "open" : "closed");
    studio.dirty = true;
  };
  $("show-drawer").onclick = studio.toggleDrawer;
  resizable(studio);
  cameras(studio);
  bindClips(studio, toJson);
}

function resizable(studio) {
  const bar = $("resize"),
    element = $("timeline"),
    set = (height) => {
      const fit = Math.round(Math.max(LOWEST, Math.min(height, innerHeight * HIGHEST)));
      document.documentElement.style.setProperty("--timeline", `${fit}px`);
      bar.setAttribute("aria-valuenow", String(fit));
      stored("timeline", String(fit));
      studio.dirty = true;
    };
  bar.setAttribute("aria-valuemin", String(LOWEST));
  if (Number(stored("timeline"))) set(Number(stored("timeline")));
  bar.onpointerdown = (event) => {
    bar.setPointerCapture(event.pointerId);
    const [from, height] = [event.clientY, element.clientHeight];
    bar.onpointermove = (next) => set(height + from - next.clientY);
    bar.onpointerup = bar.onpointercancel = () => {
      bar.onpointermove = null;
    };
  };
  bar.onkeydown = (event) => {
    const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (!way) return;
    event.preventDefault();
    event.stopPropagation();
    set(element.clientHeight + way * STEP);
  };
}

function cameras(studio) {
  const views = [];
  for (const button of document.querySelectorAll("[data-camera]")) {
    button.onclick = () => studio.view?.lookFrom(button.dataset.camera);
  }
  studio.lookFrom = (side) => studio.view?.lookFrom(side);
  $("bookmark").onclick = () => {
    if (!studio.view || views.length >= MOST_VIEWS) return studio.notes.tell(`there are ${MOST_VIEWS} views, the maximum`, true);
    const view = studio.view.bookmark(),
      button = Object.assign(document.createElement("button"), { type: "button", textContent: `view ${views.length + 1}` });
    button.title = "click to look from here, right click to remove";
    button.onclick = () => studio.view.lookFrom(view);
    button.oncontextmenu = (event) => {
      event.preventDefault();
      views.splice(views.indexOf(view), 1);
      button.remove();
    };
    views.push(view);
    $("bookmarks").append(button);
  };
}
