"use strict";
const stages = Array.from(document.querySelectorAll(".stage"));
for (const stage of stages) {
  const slider = stage.querySelector("input");
  const move = () => stage.style.setProperty("--at", slider.value + "%");
  slider.addEventListener("input", move);
  // A mouse need not press.
  stage.addEventListener("pointermove", (event) => {
    if (event.pointerType !== "mouse") return;
    const box = stage.getBoundingClientRect();
    slider.value = (100 * (event.clientX - box.left)) / box.width;
    move();
  });
}
const [left, right] = ["left", "right"].map((side) => document.getElementById(side));
const show = () => {
  for (const stage of stages) {
    for (const image of stage.querySelectorAll("img")) {
      const kind = image.dataset.kind;
      image.classList.toggle("l", kind === left.value && left.value !== right.value);
      image.classList.toggle("r", kind === right.value);
    }
    stage.querySelector(".left").textContent = left.value;
    stage.querySelector(".right").textContent = right.value;
  }
};
if (left && right) {
  for (const side of [left, right]) side.addEventListener("change", show);
  show();
}
