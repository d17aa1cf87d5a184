"use strict";
for (const press of document.querySelectorAll(".passing")) {
  const slider = press.querySelector("input"), told = press.querySelector("output");
  const states = press.querySelectorAll(".state");
  const show = () => {
    const now = states[Number(slider.value)];
    states.forEach((state) => state.classList.toggle("now", state === now));
    told.textContent = now.dataset.told;
    slider.setAttribute("aria-valuetext", now.dataset.told);
  };
  slider.addEventListener("input", show);
  press.querySelector(".control").hidden = false;
  show();
}
