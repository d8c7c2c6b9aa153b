// What every page of the station says about its connection: a line in the bar, a banner over a greyed page, remarks.

const REMARK_MS = 6000;
const SLOW_MS = 900; // a beat that is later than this is shown as late

let remarkTimer = 0;

/** Shows a remark for some seconds. */
export function remark(text, isBad = false) {
  const line = document.getElementById("remark");
  line.textContent = text;
  line.className = isBad ? "-shown -bad" : "-shown";
  clearTimeout(remarkTimer);
  remarkTimer = setTimeout(() => { line.className = ""; }, REMARK_MS);
}

/** Keeps the bar and the banner up to date with the link. */
export function watch(link) {
  const bar = document.getElementById("link");
  const title = document.title;
  let isRefused = false;

  function show() {
    const silentS = link.silentMs / 1000;
    const isLost = !link.isUp;
    const isNew = link.station === null && silentS < 2;
    document.body.classList.toggle("-lost", isLost && !isNew);
    document.title = isLost && !isNew ? `⚠ NO ANSWER – ${title}` : title;
    bar.textContent = isNew ? "connecting" : isLost ? `NO ANSWER ${silentS.toFixed(0)} s`
      : link.silentMs > SLOW_MS ? `link late ${silentS.toFixed(1)} s` : "link ok";
    bar.className = isLost ? "-bad" : link.silentMs > SLOW_MS ? "-late" : "-good";
    if (!isLost || isNew) return;
    document.getElementById("silent").textContent = `${silentS.toFixed(0)} s`;
    document.getElementById("why").textContent = isRefused
      ? "The station runs again, with another address: open the one that it has printed in its terminal."
      : link.why ? `Reason: ${link.why}.` : "";
    document.getElementById("attempt").textContent = link.waitMs > 0
      ? `Next attempt in ${Math.ceil(link.waitMs / 1000)} s.` : "Trying to reach it …";
  }

  link.addEventListener("state", show);
  link.addEventListener("hello", () => { isRefused = false; });
  link.addEventListener("lost", async () => {
    try { isRefused = (await fetch("alive", { cache: "no-store" })).status === 403; } catch { /* it is not there */ }
  });
  document.getElementById("again").addEventListener("click", () => location.reload());
  link.addEventListener("dropped", ({ detail: [ageS] }) => remark(`NOT DONE: the key came ${ageS} s late. Press it again.`, true));
  setInterval(show, 500);
  show();
}
