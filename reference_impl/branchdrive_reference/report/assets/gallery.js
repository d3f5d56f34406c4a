// The gallery: filters, and what the buttons of its cards open.

const filters = document.getElementById("filters");
if (filters !== null) {
  const cards = [...document.querySelectorAll("#cards > .card")];
  const selects = [...filters.querySelectorAll("select")];
  const reset = document.getElementById("reset-filters");
  const isLeft = (card, { value, dataset: { filter } }) => {
    const own = card.dataset[filter];
    return value === "" || (filter === "rules" ? own.split("|").includes(value) : own === value);
  };
  const choose = () => {
    let shown = 0;
    for (const card of cards) {
      card.hidden = !selects.every((select) => isLeft(card, select));
      if (!card.hidden) shown += 1;
    }
    document.getElementById("shown-groups").textContent = `${shown} of ${cards.length} groups`;
    reset.hidden = selects.every(({ value }) => value === "");
  };
  for (const select of selects) select.addEventListener("change", choose);
  reset.addEventListener("click", () => {
    for (const select of selects) select.value = "";
    selects[0].focus();
    choose();
  });
  filters.hidden = false;
  choose();
}
