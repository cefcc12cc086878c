"""The stick as a page of its own, framed by the console: two pads for thumbs, and the keyboard.

It loads nothing. It opens its socket when the operator takes the stick and closes it when he lets go; it says 20 times
a second how the stick stands, and nothing at all once the browser, the window or the page is gone. Keys count only
while the stick is taken and the window has the focus; they are taken from the 3-D view then, which they would move.
"""

from __future__ import annotations

PATH = "/stick"
"""Where the server has it; its socket has the same address."""
POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
)
"""Content-Security-Policy of the page."""
FRAME = (
    "<style>#outrider-stick{position:fixed;left:12px;bottom:150px;width:132px;height:52px;border:0;border-radius:10px;"
    "z-index:40}#outrider-stick[data-taken]{width:316px;height:246px}"
    "@media(max-width:576px){#outrider-stick{bottom:auto;top:8px;left:8px}"
    "#outrider-stick[data-taken]{top:auto;bottom:8px;left:calc(50% - 158px)}}</style>"
    '<iframe id="outrider-stick" src="/stick" title="Operator\'s stick" scrolling="no"></iframe>'
)
"""The frame around it, for the console's page. On a phone it stands on the picture, and over the panel's lower part
while the stick is taken: what the pads cover then is not the picture."""
PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Operator's stick</title>
<style>
* { box-sizing: border-box }
:root { color-scheme: dark }
body { margin: 0; font: 13px/1.3 system-ui, "Segoe UI", Roboto, sans-serif; color: #e6edf3; background: transparent;
       user-select: none; -webkit-user-select: none; overflow: hidden }
#box { background: #161b22ee; border-radius: 10px; padding: 6px; width: 132px; height: 52px }
.on #box { width: 316px; height: 246px }
button { font: 600 15px system-ui, sans-serif; width: 120px; height: 40px; border: 0; border-radius: 7px;
         background: #3a424d; color: #fff; cursor: pointer }
.on button { background: #b06000 }
#say { display: none; position: absolute; left: 136px; right: 10px; top: 8px; height: 36px; overflow: hidden;
       color: #c4ccd4; font-size: 12px }
#pads { display: none; gap: 12px; justify-content: center; margin-top: 8px }
.on #say { display: block } .on #pads { display: flex }
.pad { position: relative; width: 144px; height: 144px; border-radius: 50%; background: #22272e;
       border: 2px solid #46515c; touch-action: none; cursor: grab }
.pad.square { border-radius: 18px }
.pad i { position: absolute; font-style: normal; font-size: 11px; color: #9aa4af; pointer-events: none }
.n { top: 4px; left: 0; right: 0; text-align: center } .s { bottom: 4px; left: 0; right: 0; text-align: center }
.w { left: 6px; top: 63px } .e { right: 6px; top: 63px }
.knob { position: absolute; left: 46px; top: 46px; width: 48px; height: 48px; border-radius: 50%; background: #8b949e;
        pointer-events: none }
.moved .knob { background: #4aa8ff }
#keys { display: none; color: #9aa4af; font-size: 11px; text-align: center; margin-top: 8px; line-height: 1.5 }
.on #keys { display: block }
kbd { font: 600 11px ui-monospace, monospace; background: #2a3038; border-radius: 3px; padding: 1px 4px;
      color: #e6edf3 }
</style></head><body><div id="box">
<button id="take" aria-pressed="false">Take stick</button><div id="say" role="status"></div>
<div id="pads">
<div class="pad" id="level" aria-label="forward, back, left, right"><i class="n">forward</i><i class="s">back</i>
<i class="w">left</i><i class="e">right</i><div class="knob"></div></div>
<div class="pad square" id="mast" aria-label="up, down, turn"><i class="n">up</i><i class="s">down</i>
<i class="w">turn</i><i class="e">turn</i><div class="knob"></div></div></div>
<div id="keys"><kbd>W</kbd> <kbd>A</kbd> <kbd>S</kbd> <kbd>D</kbd> or arrows move &nbsp; let go: it hovers<br>
<kbd>Q</kbd> <kbd>E</kbd> turn &nbsp; <kbd>R</kbd> <kbd>F</kbd> up, down</div></div>
<script>
"use strict";
const TICK_MS = 50, REACH_PX = 48, DEADBAND = 0.06;
const KEYS = {
  KeyW: ["forward", 1], ArrowUp: ["forward", 1], KeyS: ["forward", -1], ArrowDown: ["forward", -1],
  KeyD: ["right", 1], ArrowRight: ["right", 1], KeyA: ["right", -1], ArrowLeft: ["right", -1],
  KeyR: ["up", 1], KeyF: ["up", -1], KeyE: ["turn", 1], KeyQ: ["turn", -1] };
const box = document.body, button = document.getElementById("take"), say = document.getElementById("say");
const pads = [ { element: document.getElementById("level"), across: "right", along: "forward" },
               { element: document.getElementById("mast"), across: "turn", along: "up" } ];
const held = new Set();
let socket = null, beat = 0;

function windows() { return parent === window ? [window] : [window, parent]; }
function letGo() { held.clear(); for (const pad of pads) pad.x = pad.y = 0; }
function looking() { return !document.hidden && windows().some((w) => w.document.hasFocus()); }

function stand() {
  const at = { forward: 0, right: 0, up: 0, turn: 0 };
  for (const pad of pads) { at[pad.across] += pad.x; at[pad.along] += pad.y; }
  for (const code of held) at[KEYS[code][0]] += KEYS[code][1];
  for (const axis in at) at[axis] = Math.max(-1, Math.min(1, at[axis]));
  return at;
}

function show(at) {
  for (const pad of pads) {
    const x = at[pad.across], y = at[pad.along];
    pad.element.lastElementChild.style.transform = `translate(${x * REACH_PX}px, ${-y * REACH_PX}px)`;
    pad.element.classList.toggle("moved", x !== 0 || y !== 0);
  }
}

function tick() {
  if (!looking()) letGo();
  const at = stand();
  show(at);
  // What waits in the browser would arrive late: better nothing, and hover.
  if (socket !== null && socket.readyState === WebSocket.OPEN && beat > 0 && socket.bufferedAmount < 1000)
    socket.send(JSON.stringify({ beat, ...at }));
}

function set(on, text) {
  letGo();
  box.classList.toggle("on", on);
  button.textContent = on ? "Let go" : "Take stick";
  button.setAttribute("aria-pressed", on);
  button.title = say.textContent = text;
  if (window.frameElement) frameElement.toggleAttribute("data-taken", on);
}

function take() {
  beat = 0;
  const opened = socket = new WebSocket(location.href.replace(/^http/, "ws"));
  set(true, "connecting …");
  opened.onmessage = (event) => {
    const told = JSON.parse(event.data);
    beat = told.beat;
    say.textContent = told.say;
  };
  opened.onclose = () => { if (socket === opened) { socket = null; set(false, "the connection was lost"); } };
}

function release() {
  const opened = socket;
  socket = null;
  if (opened !== null) opened.close();
  set(false, "");
}

button.addEventListener("click", () => { if (socket === null) take(); else release(); button.blur(); });

for (const pad of pads) {
  pad.x = pad.y = 0;
  let pointer = null;
  const follow = (event) => {
    const place = pad.element.getBoundingClientRect();
    let x = (event.clientX - place.left - place.width / 2) / REACH_PX;
    let y = -(event.clientY - place.top - place.height / 2) / REACH_PX;
    const length = Math.max(1, Math.hypot(x, y));
    x /= length; y /= length;
    pad.x = Math.abs(x) < DEADBAND ? 0 : x;
    pad.y = Math.abs(y) < DEADBAND ? 0 : y;
  };
  const end = (event) => { if (event.pointerId === pointer) { pointer = null; pad.x = pad.y = 0; tick(); } };
  pad.element.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    window.focus();
    pointer = event.pointerId;
    pad.element.setPointerCapture(pointer);
    follow(event);
  });
  pad.element.addEventListener("pointermove", (event) => {
    if (event.pointerId !== pointer) return;
    if (event.buttons === 0) end(event); else follow(event);
  });
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) pad.element.addEventListener(kind, end);
}

function typing(target) {
  return target && (target.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName));
}
function down(event) {
  if (socket === null || !(event.code in KEYS) || event.ctrlKey || event.altKey || event.metaKey) return;
  if (typing(event.target)) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (!event.repeat) held.add(event.code);
}
function up(event) { if (held.delete(event.code)) tick(); }  // at once: a short tap has to be seen as let go
const ends = new AbortController();
for (const w of windows()) {
  const options = { capture: true, signal: ends.signal };
  w.addEventListener("keydown", down, options);
  w.addEventListener("keyup", up, options);
  w.addEventListener("blur", () => { if (!looking()) letGo(); }, options);
  w.document.addEventListener("visibilitychange", letGo, options);
}
window.addEventListener("pagehide", () => { release(); ends.abort(); });
setInterval(tick, TICK_MS);
</script></body></html>
"""
