// The map's page: vehicles, a place that is tapped, and commands with a question before them.

import { Chart, colourOf, lengthText } from "./chart.js";
import { away } from "./geo.js";
import { StationLink, beside } from "./link.js";
import { remark, watch } from "./notice.js";

const MOST_POINTS = 20000;
const SAME_M = 0.03;

const part = (name) => document.getElementById(name);
const degrees = (angle) => angle === null ? "–" : `${String(Math.round(angle) % 360).padStart(3, "0")}°`;
const state = { mayCommand: true, isFollowing: false, asked: null };
const chart = new Chart(part("chart"), choose, () => follow(false));
const link = new StationLink(beside("map/ws"), () => ({}));

link.addEventListener("hello", ({ detail }) => {
  state.mayCommand = detail.may_command;
  part("role").textContent = state.mayCommand ? "" : "READ-ONLY: HOLD does nothing";
  document.body.classList.toggle("-read-only", !state.mayCommand);
  chart.tiles = detail.tiles;
  chart.trails.clear();
  const name = sessionStorage.getItem("vehicle");
  if (name) link.send("select", name);
});

link.addEventListener("map", ({ detail: [picture] }) => {
  if (chart.picture?.key !== picture.key) {
    chart.mark = null;
    chart.trails.clear();
    showCard();
    if (chart.picture) chart.fit();
  }
  chart.picture = picture;
  chart.origin = picture.origin;
  const vehicle = selected();
  part("hold").textContent = vehicle ? `HOLD ${vehicle.name}` : "HOLD";
  if (state.isFollowing && vehicle?.place) chart.centre(vehicle.place);
  showVehicles(picture);
  showCard();
  chart.draw();
});
link.addEventListener("plan", ({ detail: [plan] }) => { chart.plan = plan; chart.draw(); });
link.addEventListener("trails", ({ detail: [trails] }) => {
  for (const [name, { is_new: isNew, points }] of Object.entries(trails)) {
    const known = isNew ? [] : chart.trails.get(name) ?? [];
    for (const place of points) {
      const last = known.at(-1);
      if (!(place && last && away(last, place)[0] < SAME_M)) known.push(place);
    }
    chart.trails.set(name, known.slice(-MOST_POINTS));
  }
});
link.addEventListener("result", ({ detail: [isDone, text] }) => remark(text, !isDone));
link.addEventListener("read_only", () => remark("This page is read-only: it commands nothing.", true));
watch(link);
link.open();

const selected = () => chart.picture?.vehicles.find(({ name }) => name === chart.picture.selected);

function command(...message) {
  if (!link.command(...message)) remark("NOT SENT: the station does not answer.", true);
}

part("hold").addEventListener("click", () => {
  if (!state.mayCommand) remark("HOLD does nothing here: this page is read-only.", true);
  else if (!selected()) remark("HOLD: there is no vehicle in view.", true);
  else if (!link.command("hold", selected().name)) remark("HOLD NOT SENT: the station does not answer.", true);
});

// --- vehicles ---

function showVehicles({ vehicles, selected: name }) {
  const list = part("vehicles");
  while (list.children.length > vehicles.length) list.lastChild.remove();
  while (list.children.length < vehicles.length) {
    const row = document.createElement("button");
    row.type = "button";
    row.append(document.createElement("b"), document.createElement("small"), document.createElement("small"));
    row.addEventListener("click", () => {
      sessionStorage.setItem("vehicle", row.dataset.name);
      link.send("select", row.dataset.name);
    });
    list.append(row);
  }
  vehicles.forEach((vehicle, index) => {
    const row = list.children[index], [title, first, second] = row.children;
    row.dataset.name = title.textContent = vehicle.name;
    row.style.borderLeftColor = colourOf(vehicle.number);
    row.classList.toggle("-selected", vehicle.name === name);
    first.textContent = `${vehicle.mode} ${vehicle.is_armed ? "ARMED" : "disarmed"}${vehicle.battery_percent >= 0 ? ` ${vehicle.battery_percent} %` : ""}`;
    second.className = vehicle.is_stale ? "-stale" : "";
    second.textContent = vehicle.is_stale ? `that was ${vehicle.age_s.toFixed(0)} s ago`
      : vehicle.place === null ? "not on this map"
      : `${vehicle.height_m ?? "–"} m  ${vehicle.speed_m_s} m/s  ${degrees(vehicle.heading_deg)}`;
  });
}

// --- a place ---

function choose(place) {
  chart.mark = place;
  showCard();
  chart.draw();
}

function showCard() {
  const place = chart.mark, vehicle = selected();
  part("card").hidden = !place;
  if (!place) return;
  const geo = chart.plane?.toGeo(...place);
  const where = geo ? geo.map((value) => `${value.toFixed(6)}°`).join(", ") : `north ${place[0].toFixed(1)} m, east ${place[1].toFixed(1)} m`;
  const [distance, bearing] = vehicle?.place ? away(vehicle.place, place) : [];
  const from = vehicle?.place ? `\n${lengthText(distance)}, ${degrees(bearing)} from ${vehicle.name}` : "";
  part("place").textContent = where + from;
  part("send").textContent = vehicle ? `Send ${vehicle.name} here …` : "Send it here …";
  part("send").hidden = !vehicle || !state.mayCommand;
}

part("close").addEventListener("click", () => choose(null));
part("send").addEventListener("click", () => command("go_to", selected().name, chart.picture.key, ...chart.mark));

link.addEventListener("question", ({ detail: [question] }) => {
  state.asked = question.number;
  part("asked").textContent = question.text;
  part("height").value = question.height_m;
  part("heightname").textContent = question.height_name;
  part("question").close();
  part("question").returnValue = "no";
  part("question").show(); // HOLD stays within reach
});
part("question").addEventListener("close", () => {
  const height = part("height").valueAsNumber;
  if (part("question").returnValue !== "yes") return;
  if (Number.isNaN(height)) remark("NOT SENT: the height is no number.", true);
  else command("confirm", state.asked, height);
});

// --- tools ---

function follow(isOn) {
  state.isFollowing = isOn;
  document.querySelector("[data-do=follow]").classList.toggle("-on", isOn);
  if (isOn && selected()?.place) chart.centre(selected().place);
}

const TOOLS = {
  in: () => chart.zoom(1), out: () => chart.zoom(-1),
  fit: () => { follow(false); chart.fit(); }, follow: () => follow(!state.isFollowing),
};
for (const button of document.querySelectorAll("#tools button")) button.addEventListener("click", TOOLS[button.dataset.do]);
