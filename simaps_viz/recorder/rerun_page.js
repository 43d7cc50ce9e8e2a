// Runs rerun 0.41's web viewer on the whole page and keeps its time cursor in step with the workbench.
//
// Workbench to rerun: server-sent events at /rerun/events, {"set_time": {"timeline": "frame", "time": 12}}; "recording"
// ("recording:APPLICATION:ID") and "play" ("paused", "playing" or "following") may be given too; or
// {"show": "/recordings/other.rrd"}.
// Rerun to workbench: every viewer event (time_update, selection_change, recording_open, ...) as JSON to /rerun/event,
// except the time_update that only echoes a time set from outside. A time_update tells its timeline too, whether it
// comes of following a stream, and whether anybody has touched this page yet.
"use strict";

// rerun tells its debugging 18,000 times while it opens a recording, which takes longer than opening it.
console.debug = () => {};

// rerun asks for recordings without a cookie, and where tokens are asked for the server answers only who has one. It
// also sends usage data, which cannot be switched off in a browser: answered here, they are not even tried, and the
// console does not fill with what the policy of this page refuses.
const USAGE = "tel.rerun.io";
const fetchWithout = window.fetch.bind(window);
window.fetch = (asked, options) => {
  const address = new URL(asked instanceof Request ? asked.url : asked, location.href);
  if (address.hostname === USAGE) return Promise.resolve(new Response(null, { status: 204 }));
  const own = asked instanceof Request && address.origin === location.origin;
  return fetchWithout(own ? new Request(asked, { credentials: "same-origin" }) : asked, options);
};

const config = JSON.parse(document.getElementById("config").textContent);

// Light or dark: as the workbench around this page is, which is asked for it and tells every change; alone, as the
// system is. rerun changes its look while it runs only when the system does: what it asks the system, we answer.
const askSystem = window.matchMedia.bind(window);
const inSystem = askSystem("(prefers-color-scheme: dark)");
const docked = window.parent !== window;
const preferences = [];
let dark = config.theme === "dark";

class Preference extends EventTarget {
  constructor(media, wanted) {
    super();
    this.media = media;
    this.wanted = wanted;
  }

  get matches() {
    return dark === (this.wanted === "dark");
  }
}

window.matchMedia = (media) => {
  const asked = /^\(prefers-color-scheme: *(dark|light)\)$/.exec(media);
  if (!asked) return askSystem(media);
  preferences.push(new Preference(media, asked[1]));
  return preferences[preferences.length - 1];
};

function setDark(wanted) {
  dark = wanted;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  for (const one of preferences)
    one.dispatchEvent(new MediaQueryListEvent("change", { media: one.media, matches: one.matches }));
}

function followTheme() {
  setDark(inSystem.matches);
  if (!docked) {
    inSystem.addEventListener("change", () => setDark(inSystem.matches));
    return;
  }
  window.addEventListener("message", (message) => {
    const theme = message.source === window.parent && message.data ? message.data.simapsTheme : null;
    if (theme !== "light" && theme !== "dark") return;
    page = message.origin;
    setDark(theme === "dark");
  });
  window.parent.postMessage("simaps: light or dark?", "*");
}

// Keys, while the recording has them: Tab leaves it (rerun would keep it for ever), those that rerun does not know go
// to the workbench, and all of them are rerun's while somebody types in one of its boxes.
const OF_RERUN = new Set([" ", "enter", "home", "end", "pageup", "pagedown", "w", "a", "s", "d", "q", "e"]);
const typing = () => document.activeElement instanceof HTMLInputElement;
let page = null; // the workbench's origin, once it has spoken

function isOfRerun(event) {
  if (event.altKey) return true;
  if (event.ctrlKey || event.metaKey) return event.key !== "k"; // which searches all commands of the workbench
  return event.key.startsWith("Arrow") || OF_RERUN.has(event.key.toLowerCase());
}

function passOn(event) {
  if (page === null || event.isComposing) return;
  const { key, code, shiftKey, ctrlKey, metaKey } = event;
  const leaves = key === "Tab" && !ctrlKey && !metaKey && !event.altKey;
  if (!leaves && (typing() || isOfRerun(event))) return;
  if (key !== "Escape") {
    event.preventDefault();
    event.stopImmediatePropagation();
  }
  const said = leaves ? { simapsLeave: shiftKey ? -1 : 1 } : { simapsKey: { key, code, shiftKey, ctrlKey, metaKey } };
  window.parent.postMessage(said, page);
}

// A stream shows a build that needs the processors itself, and without a graphics card drawing takes them all: after
// each picture comes a rest of several times what it took, unless somebody is at it. Opening the stream takes no rest.
const RESTS = 6;
const LONGEST_REST_MS = 3000;
const AT_IT_MS = 2000;
const drawSoon = window.requestAnimationFrame.bind(window);
const drawNever = window.cancelAnimationFrame.bind(window);
const resting = new Map(); // {what the caller knows: timer or request}
let lastRest = 0;
let drawnAt = 0;
let drawingMs = 0;
let atItAt = 0; // somebody here, or the workbench
let handledAt = 0; // somebody here

const isAtIt = () => (atItAt = performance.now());
const isHandled = () => (handledAt = isAtIt());

function drawNow(key, draw) {
  resting.set(key, {
    request: drawSoon((time) => {
      resting.delete(key);
      const began = performance.now();
      draw(time);
      drawSoon(() => {
        drawnAt = performance.now();
        drawingMs = drawnAt - began;
      });
    }),
  });
}

function drawCalmly(draw) {
  const key = ++lastRest;
  const now = performance.now();
  const restMs = ids.size && now - atItAt > AT_IT_MS ? Math.min(RESTS * drawingMs, LONGEST_REST_MS) : 0;
  const wait = restMs - (now - drawnAt);
  if (wait <= 0) drawNow(key, draw);
  else resting.set(key, { timer: setTimeout(() => drawNow(key, draw), wait) });
  return key;
}

function drawNoMore(key) {
  const one = resting.get(key);
  if (!one) return;
  resting.delete(key);
  if (one.timer !== undefined) clearTimeout(one.timer);
  else drawNever(one.request);
}

function restBetweenPictures() {
  window.requestAnimationFrame = drawCalmly;
  window.cancelAnimationFrame = drawNoMore;
  for (const what of ["pointerdown", "pointermove", "wheel", "keydown"]) window.addEventListener(what, isHandled, true);
}

// A view is chosen by a click in it, or on its name, where rerun shows a grabbing hand.
const overName = () => document.getElementById("viewer").style.cursor.startsWith("grab");
let pressedName = false;
let touched = false; // whether somebody has pressed anything here: before that rerun moves by itself

function watchInput() {
  window.addEventListener("pointerdown", () => (pressedName = overName()), true);
  for (const what of ["pointerdown", "keydown"]) window.addEventListener(what, () => (touched = true), true);
  if (docked) window.addEventListener("keydown", passOn, true);
}

// viewer_control.proto of rerun 0.41: ViewerControlRequest holds SetTimeCursor in field 6.
const PLAY_STATES = { paused: 1, playing: 2, following: 3 };

function varint(value) {
  const bytes = [];
  let rest = BigInt.asUintN(64, BigInt(value));
  do {
    let byte = Number(rest & 127n);
    rest >>= 7n;
    if (rest) byte |= 128;
    bytes.push(byte);
  } while (rest);
  return bytes;
}

const field = (number, bytes) => [(number << 3) | 2, ...varint(bytes.length), ...bytes];
const text = (number, string) => field(number, [...new TextEncoder().encode(string)]);

function encodeSetTime({ recording, timeline, time, play }) {
  const message = [];
  if (recording) message.push(...text(1, recording));
  if (timeline) message.push(...field(2, text(1, timeline)));
  if (time !== undefined) message.push(...field(3, time === 0 ? [] : [1 << 3, ...varint(time)]));
  if (play) message.push(5 << 3, PLAY_STATES[play]);
  return new Uint8Array(field(6, message));
}

// Times set from outside, so that their echo can be told from a person's scrubbing: when rerun had taken each, Infinity
// until then, however long it is at it. {"timeline time": milliseconds}
const ECHO_MS = 1500;
const commanded = new Map();

function isEcho(event) {
  if (event.type !== "time_update") return false;
  if (wanted && event.timeline === wanted.command.timeline && handledAt <= wanted.since) return true;
  const since = commanded.get(`${event.timeline} ${Number(event.time)}`);
  return since !== undefined && performance.now() - since < ECHO_MS;
}

// A recording comes to the front a while after it was asked for: times are meant for the one asked for last.
function absolute(address) { // rerun wants them so, those of streams with a scheme of their own
  const stream = address.startsWith("rerun+/") ? "rerun+" : "";
  return stream + new URL(address.slice(stream.length), location.href).href;
}
let asked = config.recordings.length ? absolute(config.recordings[0]) : "";
const ids = new Map(); // {address: what rerun calls that recording}

// One command at a time; while it is under way only the newest of the waiting ones survives.
let viewer = null;
let waiting = null;
let busy = false;

let following = false; // the stream's newest frame, as the workbench said

async function setTime(command) {
  isAtIt();
  insistOn(command);
  waiting = command;
  if (busy || !viewer) return;
  busy = true;
  while (waiting) {
    const next = waiting;
    waiting = null;
    following = next.play === "following";
    const key = `${next.timeline} ${next.time}`;
    commanded.set(key, Infinity);
    if (commanded.size > 500) commanded.delete(commanded.keys().next().value);
    try {
      await viewer.viewer_control(encodeSetTime({ recording: ids.get(asked), play: "paused", ...next }));
    } catch (error) {
      console.error("set_time", error.code, error.message);
    }
    commanded.set(key, performance.now());
  }
  busy = false;
}

// A stream may not have brought yet what rerun is sent to, which then stays at what there is: it is sent there again,
// unless somebody here goes elsewhere.
const INSIST_MS = 500;
const INSIST_FOR_MS = 60000;
const streamed = config.recordings.some((address) => address.startsWith("rerun+"));
const told = new Map(); // {timeline: the last time that rerun told}
let wanted = null;

function insistOn(command) {
  if (!streamed || command === wanted?.command) return;
  if (wanted) clearTimeout(wanted.timer);
  wanted = command.time === undefined ? null : { command, since: performance.now() };
  if (wanted) wanted.timer = setTimeout(insist, INSIST_MS);
}

function insist() {
  const { command, since } = wanted;
  const is = told.get(command.timeline);
  if (is === command.time || handledAt > since || performance.now() - since > INSIST_FOR_MS) {
    wanted = null;
    return;
  }
  setTime(command);
  wanted.timer = setTimeout(insist, INSIST_MS);
}

// Events leave in order; of several waiting time updates only the newest one does.
const outbox = [];
let posting = false;

async function post(event) {
  const last = outbox.length - 1;
  if (last >= 0 && event.type === "time_update" && outbox[last].type === "time_update") outbox[last] = event;
  else outbox.push(event);
  if (posting) return;
  posting = true;
  while (outbox.length) {
    const body = JSON.stringify(outbox.shift());
    try {
      await fetch("/rerun/event" + location.search, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    } catch (error) {
      console.warn("the workbench did not take an event", error);
    }
  }
  posting = false;
}

let timeline = null;

function onViewerEvent(json) {
  const event = JSON.parse(json);
  tell(event);
  // A timeline that was shown before comes back at its old time, which rerun does not tell as one.
  if (event.type === "timeline_change" && event.timeline !== "frame" && event.time !== null)
    tell({ ...event, type: "time_update" });
}

function tell(event) {
  if (event.type === "recording_open" && !ids.has(asked))
    ids.set(asked, `recording:${event.application_id}:${event.recording_id}`);
  if (event.type === "timeline_change") timeline = event.timeline;
  if (event.type === "time_update") {
    event.timeline = timeline;
    event.following = following;
    event.touched = touched;
    told.set(timeline, Number(event.time));
  }
  if (event.type === "selection_change" && (pressedName || overName()))
    for (const item of event.items) item.by_name = true;
  window.simapsEvents.push(event);
  if (window.simapsEvents.length > 500) window.simapsEvents.splice(0, 250);
  if (!isEcho(event)) post(event);
}

// A browser opens six connections to a host, for all its tabs: one that nobody looks at gives its own back. On its
// return the workbench tells it the frame anew.
let source = null;

function listen() {
  if (source || document.visibilityState === "hidden") return;
  source = new EventSource("/rerun/events" + location.search);
  source.onmessage = (message) => {
    const data = JSON.parse(message.data);
    if (data.set_time) setTime(data.set_time);
    if (data.show) show(data.show);
  };
}

function listenWhileVisible() {
  listen();
  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState === "hidden" && source) {
      source.close();
      source = null;
    } else listen();
  });
}

// The recorded layout folds the time panel into one row, which rerun leaves out where it does not fit.
const NARROW_PX = 640;
const timePanel = () => (window.innerWidth < NARROW_PX ? "expanded" : null);

function keepTimePanel() {
  let state = timePanel();
  viewer.override_panel_state("time", state);
  window.addEventListener("resize", () => {
    if (timePanel() === state) return;
    state = timePanel();
    viewer.override_panel_state("time", state);
  });
}

// Another recording comes to the front; those loaded already stay in the viewer's memory, and come back at once.
function show(address) {
  asked = absolute(address);
  viewer.add_receiver(asked);
  viewer.override_panel_state("time", timePanel()); // a viewer at rest would not look for it until the mouse moves
}

function showFailure(error) {
  const message = document.getElementById("message");
  message.textContent = `The recording cannot be shown here (${error}). It needs WebGL 2 and WebAssembly.`;
  message.hidden = false;
  console.error(error);
}

async function main() {
  await wasm_bindgen({ module_or_path: "/rerun/re_viewer_bg.wasm" });
  const handle = new wasm_bindgen.WebHandle({
    url: config.recordings.map(absolute),
    theme: "system",
    hide_welcome_screen: true,
    enable_history: false,
    check_for_updates_on_startup: false,
    persist: false,
    panel_state_overrides: { top: "Hidden", blueprint: "Hidden", selection: "Hidden" },
    on_viewer_event: onViewerEvent,
  });
  await handle.start(document.getElementById("viewer"));
  viewer = handle;
  keepTimePanel();
  document.getElementById("message").hidden = true;
  listenWhileVisible();
  window.simapsReady = true;
}

window.simapsEvents = [];
window.simapsReady = false;
window.simapsSetTime = setTime;
watchInput();
if (streamed) restBetweenPictures();
if (config.theme === "page") followTheme();
main().catch(showFailure);
