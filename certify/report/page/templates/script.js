(function () {
  "use strict";
  var root = document.documentElement;
  root.classList.add("scripted");

  // The theme: that of the system, unless another is chosen; kept if the browser lets a local page keep anything.
  var button = document.getElementById("theme");
  function kept(value) {
    try {
      if (value === undefined) { return window.localStorage.getItem("certify-theme"); }
      window.localStorage.setItem("certify-theme", value);
    } catch (error) { /* a page from a file may not */ }
    return null;
  }
  function isDark() {
    var own = root.getAttribute("data-theme");
    return own ? own === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  }
  function show() { button.textContent = isDark() ? "Light theme" : "Dark theme"; }
  var before = kept();
  if (before === "dark" || before === "light") { root.setAttribute("data-theme", before); }
  button.addEventListener("click", function () {
    var theme = isDark() ? "light" : "dark";
    root.setAttribute("data-theme", theme);
    kept(theme);
    show();
  });
  show();

  // Claims by status and text.
  var claims = Array.prototype.slice.call(document.querySelectorAll("details.claim"));
  var kinds = Array.prototype.slice.call(document.querySelectorAll(".kind"));
  var buttons = Array.prototype.slice.call(document.querySelectorAll("button[data-status]"));
  var search = document.getElementById("search");
  var count = document.getElementById("count");
  var status = "";
  function filter() {
    var words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    var shown = 0;
    claims.forEach(function (claim) {
      var text = claim.getAttribute("data-text");
      var good = (!status || claim.classList.contains(status)) && words.every(function (w) { return text.indexOf(w) >= 0; });
      claim.classList.toggle("hidden", !good);
      shown += good ? 1 : 0;
    });
    kinds.forEach(function (kind) {
      kind.classList.toggle("empty", !kind.querySelector("details.claim:not(.hidden)"));
    });
    count.textContent = shown + " of " + claims.length + " shown";
  }
  buttons.forEach(function (each) {
    each.addEventListener("click", function () {
      status = each.getAttribute("data-status");
      buttons.forEach(function (other) { other.setAttribute("aria-pressed", String(other === each)); });
      filter();
    });
  });
  if (search) { search.addEventListener("input", filter); }

  // A link to a claim opens it, and shows it if the filter hides it.
  function openTarget() {
    var target = document.getElementById(window.location.hash.slice(1));
    var claim = target && target.closest("details");
    if (claim) {
      if (claim.classList.contains("hidden")) {
        search.value = "";
        buttons[0].click();
      }
      claim.open = true;
      claim.querySelector("summary").focus({ preventScroll: true });
      claim.scrollIntoView();
    }
  }
  window.addEventListener("hashchange", openTarget);
  document.addEventListener("click", function (event) {
    var link = event.target.closest && event.target.closest("a[href^='#']");
    if (link && link.getAttribute("href") === window.location.hash) { openTarget(); }
  });
  if (window.location.hash) { openTarget(); }

  // Paper shows everything.
  var opened = [];
  window.addEventListener("beforeprint", function () {
    opened = Array.prototype.slice.call(document.querySelectorAll("details:not([open])"));
    opened.forEach(function (each) { each.open = true; });
  });
  window.addEventListener("afterprint", function () {
    opened.forEach(function (each) { each.open = false; });
  });
})();
