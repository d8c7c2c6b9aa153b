// Keys for fingers: what the terminal needs and a phone's keyboard does not have, and HOLD.

const ESCAPE = "\x1b";
const ROWS = [
  ..."1234567890",
  ["esc", ESCAPE], ["tab", "\t"], ["←", `${ESCAPE}[D`], ["↓", `${ESCAPE}[B`], ["↑", `${ESCAPE}[A`], ["→", `${ESCAPE}[C`],
  ["⏎", "\r", "enter"], ["y", "y"], ["n", "n"], ["v", "v", "the next vehicle"],
  ["HOLD"],
  ["≡", "\x10", "all commands"], ["?", "?", "help"], ["x", "x", "acknowledge the alert"],
  ["A", "larger", "larger letters, to be moved about"], ["⌨", "keyboard", "keyboard"],
];

/** Fills a bar with the keys; `does` has what they do: press, hold, keyboard, larger, isLarger. */
export function showTouchKeys(bar, does) {
  for (const [label, keys = label, name = label] of ROWS) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    button.setAttribute("aria-label", name);
    // The focus stays where it is: otherwise the keyboard of the screen would close.
    button.addEventListener("pointerdown", (event) => event.preventDefault());
    button.addEventListener("click", () => {
      if (label === "HOLD") does.hold();
      else if (keys in does) does[keys](button.classList.toggle("-on"));
      else does.press(keys);
    });
    if (label === "HOLD") button.className = "hold";
    if (keys === "larger") button.classList.toggle("-on", does.isLarger);
    bar.append(button);
  }
}
