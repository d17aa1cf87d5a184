"use strict";
for (const press of document.querySelectorAll(".intermediate")) {
  const slider = press.querySelector("input"), label = press.querySelector("output");
  const states = press.querySelectorAll(".state");
  const show = () => {
    const now = states[Number(slider.value)];
    states.forEach((state) => state.classList.toggle("now", state === now));
    label.textContent = now.dataset.label;
    slider.setAttribute("aria-valuetext", now.dataset.label);
  };
  slider.addEventListener("input", show);
  press.querySelector(".control").hidden = false;
  show();
}
