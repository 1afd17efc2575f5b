// A block that scrolls is reached by the keyboard, a button that copies is no landmark, and the
// search has a name.
const reach = () => {
  document.querySelectorAll(".md-code__nav").forEach((one) => one.setAttribute("role", "none"));
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll("pre > code, .equations, .md-typeset__scrollwrap").forEach((one) => {
    if (one.scrollWidth > one.clientWidth) one.tabIndex = 0;
  });
};
new MutationObserver(reach).observe(document.body, { childList: true, subtree: true });
addEventListener("load", reach);
addEventListener("resize", reach);
