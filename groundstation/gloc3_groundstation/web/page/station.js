// The terminal's page: textual.js draws the terminal, over a link that lasts; HOLD and touch keys are real buttons.

import { StationLink, beside } from "./link.js";
import { remark, watch } from "./notice.js";
import { showTouchKeys } from "./touch.js";

const READABLE = 13; // pixels of the larger font on a small screen, whose terminal is then moved about
const CELL = { width: 0.6, height: 1.35 }; // of a character, in font sizes
const SMALLEST = { columns: 80, lines: 24 };

const place = document.querySelector("main");
const terminal = document.getElementById("terminal");
const state = { mayCommand: true, isShown: true, size: { width: 80, height: 24 }, forced: null };

const link = new StationLink(beside("ws"), () => ({ ...state.size, window: windowName(), was_shown: state.isShown }));

/** Names this window, the same after it was loaded again. */
function windowName() {
  const made = sessionStorage.getItem("window") ?? crypto.getRandomValues(new Uint32Array(2)).join("-");
  sessionStorage.setItem("window", made);
  return made;
}

/** What textual.js takes for a websocket. */
class TerminalSocket extends EventTarget {
  constructor(address) {
    super();
    const asked = new URL(address).searchParams;
    state.size = { width: Number(asked.get("width")), height: Number(asked.get("height")) };
    link.addEventListener("message", ({ data }) => this.dispatchEvent(new MessageEvent("message", { data })));
    link.addEventListener("hello", () => this.dispatchEvent(new Event("open")), { once: true });
    link.open();
  }

  send(text) {
    const [kind, value] = JSON.parse(text);
    if (kind === "stdin") return press(value);
    if (kind === "resize") state.size = value;
    if (kind !== "ping") link.send(kind, ...(value === undefined ? [] : [value]));
  }
}
window.WebSocket = TerminalSocket;

/** Sends keys, as a terminal has them; says so where they do not get there. */
function press(keys) {
  if (!state.mayCommand) return;
  if (!link.command("stdin", keys)) remark("NOT SENT: the station does not answer.", true);
}

function hold() {
  if (!state.mayCommand) return remark("HOLD does nothing here: this page is read-only.", true);
  if (!link.command("hold")) remark("HOLD NOT SENT: the station does not answer.", true);
}

link.addEventListener("hold", ({ detail: [vehicle] }) => vehicle
  ? remark(`HOLD: ${vehicle}. The terminal shows its reply; HOLD again: land, disarm.`)
  : remark("HOLD: there is no vehicle in view.", true));
link.addEventListener("read_only", () => remark("This page is read-only: keys and HOLD do nothing.", true));
link.addEventListener("shown", ({ detail: [isShown] }) => { state.isShown = isShown; });
link.addEventListener("hello", ({ detail }) => {
  state.mayCommand = detail.may_command;
  document.getElementById("role").textContent = state.mayCommand ? "" : "READ-ONLY: keys and HOLD do nothing";
  document.body.classList.toggle("-read-only", !state.mayCommand);
});
link.addEventListener("size", ({ detail: [columns, lines] }) => {
  state.forced = columns === null ? null : { columns, lines };
  fit();
});
watch(link);

for (const button of document.querySelectorAll("[data-do=hold]")) button.addEventListener("click", hold);

// --- size ---

const wished = Math.round(Number(new URL(location.href).searchParams.get("fontsize")));

/** The font size in which 80 × 24 characters fit, 16 pixels at most; or the one that was wished for. */
function fontSize() {
  const dots = Math.floor((place.clientWidth * devicePixelRatio) / SMALLEST.columns); // a character has whole ones
  const across = (dots / devicePixelRatio / CELL.width) * 1.003;
  const fitting = Math.min(across, place.clientHeight / (SMALLEST.lines * CELL.height), 16);
  return Math.max(6, Math.min(64, wished || Math.floor(fitting * 100) / 100));
}

/** Lays the terminal out: to fill its place, 80 × 24 characters at least, or scaled as the window that it mirrors. */
function fit() {
  const screen = terminal.querySelector(".xterm-screen");
  const style = terminal.style;
  style.width = style.height = style.right = style.bottom = style.transform = "";
  if (state.forced && screen) {
    const cell = { width: screen.clientWidth / state.size.width, height: screen.clientHeight / state.size.height };
    const [width, height] = [(state.forced.columns + 0.5) * cell.width, (state.forced.lines + 0.5) * cell.height];
    const scale = Math.min(place.clientWidth / width, place.clientHeight / height);
    Object.assign(style, { right: "auto", bottom: "auto", width: `${width}px`, height: `${height}px`, transform: `scale(${scale})` });
  }
  window.onresize?.(); // textual.js fits the terminal into its element
}

if (wished) {
  place.classList.add("-wide");
  terminal.style.minWidth = `${Math.ceil(SMALLEST.columns * CELL.width * wished)}px`;
  terminal.style.minHeight = `${Math.ceil(SMALLEST.lines * CELL.height * wished)}px`;
}
showTouchKeys(document.getElementById("touch"), {
  press,
  hold,
  keyboard(isOn) {
    if (!field()) return;
    field().inputMode = isOn ? "text" : "none";
    field().blur();
    focus();
  },
  larger() {
    const address = new URL(location.href);
    if (wished) address.searchParams.delete("fontsize");
    else address.searchParams.set("fontsize", READABLE);
    location.replace(address);
  },
  isLarger: Boolean(wished),
});

terminal.dataset.sessionWebsocketUrl = beside("ws");
terminal.dataset.fontSize = String(fontSize());
new ResizeObserver(fit).observe(place);

// The keyboard on the screen of a phone takes room from the page.
visualViewport?.addEventListener("resize", () => {
  document.body.style.setProperty("--height", `${visualViewport.height}px`);
  scrollTo(0, 0);
});

// --- keys ---

const field = () => terminal.querySelector("textarea");
const isTouch = matchMedia("(pointer: coarse), (max-width: 600px)").matches;
const focus = () => document.body.classList.contains("-loaded") && field()?.focus({ preventScroll: true });
new MutationObserver(() => {
  if (isTouch && field()) field().inputMode = "none"; // the keyboard of the screen opens by its key alone
  focus();
}).observe(document.body, { attributeFilter: ["class"] });
window.addEventListener("focus", focus);
