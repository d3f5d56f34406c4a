// Light and dark: what the system asks for, until somebody chooses; and what is folded, until an address leads to it.

const probe = document.createElement("span");
probe.hidden = true;
document.body.append(probe);
const inks = new Map();

/** The colour that a custom property of the style has now. */
function ink(name) {
  if (!inks.has(name)) {
    probe.style.color = `var(--${name})`;
    inks.set(name, getComputedStyle(probe).color);
  }
  return inks.get(name);
}

const systemIsDark = matchMedia("(prefers-color-scheme: dark)");
const themeButtons = [...document.querySelectorAll("#theme, #player-theme")];

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : systemIsDark.matches;
}

function themeChanged() {
  inks.clear();
  for (const button of themeButtons) button.textContent = isDark() ? "Light" : "Dark";
  dispatchEvent(new Event("themechange"));
}

for (const button of themeButtons) {
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    themeChanged();
  });
}
systemIsDark.addEventListener("change", themeChanged);
themeChanged();

function unfold() {
  const target = document.getElementById(location.hash.slice(1));
  if (target?.tagName === "DETAILS") {
    target.open = true;
    target.scrollIntoView();
  }
}
addEventListener("hashchange", unfold);
unfold();
