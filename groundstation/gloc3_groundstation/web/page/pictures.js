// The pictures page: the latest picture of a camera, and HOLD.

import { StationLink, beside } from "./link.js";
import { remark, watch } from "./notice.js";

const MOST = [640, 480]; // pixels that the vehicle makes at most

const part = (name) => document.getElementById(name);
const link = new StationLink(beside("pictures/ws"), () => ({}));
let mayCommand = true;
let shown = "";

link.addEventListener("hello", ({ detail }) => {
  mayCommand = detail.may_command;
  part("role").textContent = mayCommand ? "" : "READ-ONLY: HOLD does nothing";
  const name = sessionStorage.getItem("vehicle");
  if (name) link.send("select", name);
  sendRoom();
});

link.addEventListener("cameras", ({ detail: [state] }) => {
  fill(part("vehicle"), state.vehicles, state.selected);
  fill(part("camera"), state.cameras, state.camera);
  part("hold").textContent = state.selected ? `HOLD ${state.selected}` : "HOLD";
  part("problem").textContent = state.problem;
  const isOther = `${state.selected}/${state.camera}` !== shown;
  part("picture").hidden = isOther;
  part("picture").classList.toggle("-stale", state.problem !== "");
  if (isOther) part("size").textContent = "";
});

link.addEventListener("picture", ({ detail: [vehicle, camera, size, data] }) => {
  shown = `${vehicle}/${camera}`;
  part("picture").src = `data:image/webp;base64,${data}`;
  part("picture").hidden = false;
  part("size").textContent = size;
});

link.addEventListener("result", ({ detail: [isDone, text] }) => remark(text, !isDone));
link.addEventListener("read_only", () => remark("This page is read-only: it commands nothing.", true));
watch(link);
link.open();

/** Fills a choice, unless it holds the same already. */
function fill(choice, names, chosen) {
  const known = [...choice.options].map(({ value }) => value);
  if (known.length !== names.length || names.some((name, index) => name !== known[index]))
    choice.replaceChildren(...names.map((name) => new Option(name.replace("camera/", ""), name)));
  choice.disabled = names.length === 0;
  if (document.activeElement !== choice) choice.value = chosen;
}

function sendRoom() {
  const { clientWidth, clientHeight } = part("frame");
  const scale = devicePixelRatio || 1;
  link.send("room", Math.min(MOST[0], Math.round(clientWidth * scale)), Math.min(MOST[1], Math.round(clientHeight * scale)));
}

addEventListener("resize", sendRoom);
part("vehicle").addEventListener("change", ({ target }) => {
  sessionStorage.setItem("vehicle", target.value);
  link.send("select", target.value);
  target.blur();
});
part("camera").addEventListener("change", ({ target }) => { link.send("camera", target.value); target.blur(); });
part("hold").addEventListener("click", () => {
  const name = part("vehicle").value;
  if (!mayCommand) remark("HOLD does nothing here: this page is read-only.", true);
  else if (!name) remark("HOLD: there is no vehicle in view.", true);
  else if (!link.command("hold", name)) remark("HOLD NOT SENT: the station does not answer.", true);
});
