"""The page that asks for the console's password: loads nothing, sends the password in a header, not an address."""

from __future__ import annotations

PATH = "/login"
"""Where the page sends the password, as HTTP basic credentials."""
POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the page."""
PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Outrider console</title>
<style>
body { margin: 0; min-height: 100vh; display: grid; place-items: center; background: #101418; color: #e6e9ec;
       font: 16px system-ui, sans-serif }
form { display: grid; gap: 12px; width: 280px; padding: 28px; background: #1b2127; border-radius: 10px }
h1 { margin: 0 0 4px; font-size: 20px }
input, button { font: inherit; padding: 9px 11px; border-radius: 6px; border: 1px solid #46515c }
input { background: #101418; color: inherit }
button { background: #2f7dd1; border-color: #2f7dd1; color: #fff; cursor: pointer }
button:disabled { opacity: .6 }
p { margin: 0; min-height: 1.3em; color: #ff9f5a }
</style></head><body>
<form><h1>Outrider console</h1>
<label for="password">Password</label>
<input id="password" type="password" autocomplete="current-password" autofocus>
<button>Open the console</button><p role="alert"></p></form>
<script>
const form = document.forms[0], field = form.querySelector("input"), button = form.querySelector("button");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  button.disabled = true;
  let text = "The console does not answer.";
  try {
    const bytes = new TextEncoder().encode("operator:" + field.value);
    const answer = await fetch("/login", {
      headers: { Authorization: "Basic " + btoa(String.fromCharCode(...bytes)) }, cache: "no-store" });
    if (answer.ok) { location.replace("/"); return; }
    text = await answer.text();
  } catch (error) { /* the text stays */ }
  form.querySelector("p").textContent = text;
  button.disabled = false;
  field.select();
});
</script></body></html>
"""
