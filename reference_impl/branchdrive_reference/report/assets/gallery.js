// The gallery: filters, and what the buttons of its cards open.

const filters = document.getElementById("filters");
if (filters !== null) {
  const cards = [...document.querySelectorAll("#cards > .card")];
  const selects = [...filters.querySelectorAll("select")];
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
  };
  for (const select of selects) select.addEventListener("change", choose);
  filters.hidden = false;
  choose();
}
