// Long names in tables break at their joints (after / _ . :), not in the middle of a word; what is copied stays as it is.
document.addEventListener("DOMContentLoaded", () => {
  for (const name of document.querySelectorAll("table.docutils code .pre")) {
    const parts = name.textContent.split(/(?<=[/_.:])(?=\w)/);
    name.replaceChildren(...parts.flatMap((part, i) => (i ? [document.createElement("wbr"), part] : [part])));
  }
});
