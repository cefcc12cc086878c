"""The look of the page: one style sheet, sent as HTML into the panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

GREEN = "#3ddc84"
ORANGE = "#ff9f1c"
RED = "#ff5a52"
GREY = "#8b949e"
BLUE = "#4aa8ff"

_SHEET = """
.or{font:13px/1.35 system-ui,"Segoe UI",Roboto,sans-serif;color:#e6edf3;padding:0 10px 6px}
.or.free{padding:0}
.or *{box-sizing:border-box}
.or .head{border-radius:7px;padding:7px 10px;margin-bottom:6px;border-left:4px solid;font-weight:700;font-size:14px;
  height:36px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis}
.or .al{border-radius:7px;padding:7px 12px;margin-bottom:6px;border-left:4px solid;box-shadow:0 2px 8px #000a}
.or .al b{display:block;font-size:15px}
.or .als{position:fixed;z-index:50;top:12px;right:RIGHTpx;width:min(360px,calc(100vw - RESTpx));
  pointer-events:none;opacity:.94}
@media(max-width:800px){.or .als,.or .hud{position:static;width:auto}}
@media(max-width:576px){.mantine-Paper-root:has(.or){width:100%!important}
  .mantine-ScrollArea-content:has(.or)>div{width:100%!important}}
.or .hud{position:fixed;z-index:30;bottom:150px;right:RIGHTpx;width:222px;padding:8px 6px;border-radius:10px;
  background:#0d1117cc;text-align:center;font-size:13px;pointer-events:none;font-variant-numeric:tabular-nums}
.or .hud svg{display:block;margin:0 auto 4px}
.or .hud small{color:#c4ccd4}
.or .danger{background:#4a1517;border-color:#ff5a52}
.or .warning{background:#47310b;border-color:#ff9f1c}
.or .notice{background:#14304d;border-color:#4aa8ff}
.or .well{background:#12321f;border-color:#3ddc84}
.or .top{display:flex;gap:6px;margin-bottom:6px}
.or .pill{flex:1;text-align:center;border-radius:7px;padding:6px 4px;font-weight:700;font-size:14px;
  background:#2a3038;white-space:nowrap;overflow:hidden;text-overflow:ellipsis}
.or .pill small{display:block;font-weight:500;font-size:10px;letter-spacing:.06em;text-transform:uppercase;opacity:.75}
.or .fig{display:grid;grid-template-columns:repeat(4,1fr);gap:5px;margin-bottom:6px}
.or .fig div{background:#22272e;border-radius:7px;padding:5px 2px;text-align:center;font-size:17px;font-weight:650;
  font-variant-numeric:tabular-nums;white-space:nowrap}
.or .fig small{display:block;font-size:10px;font-weight:500;color:#9aa4af}
.or .fig i{font-style:normal;font-size:11px;font-weight:500;color:#9aa4af}
.or .row{display:flex;justify-content:space-between;gap:8px;padding:2px 0;font-variant-numeric:tabular-nums}
.or .row span:first-child{color:#9aa4af;white-space:nowrap}
.or .row span:last-child{text-align:right}
.or .why{color:#c4ccd4;font-size:12px;margin:2px 0 4px}
.or .two{height:34px;overflow:hidden}
.or .g{color:#3ddc84}.or .o{color:#ff9f1c}.or .r{color:#ff5a52}.or .d{color:#8b949e}
.or table{width:100%;border-collapse:collapse;font-size:12px;font-variant-numeric:tabular-nums}
.or td,.or th{padding:3px 4px;text-align:right;border-top:1px solid #2b313a;vertical-align:top}
.or th{font-weight:500;color:#9aa4af;border-top:0}
.or td:first-child,.or th:first-child{text-align:left}
.or .ck{display:grid;grid-template-columns:20px 1fr;gap:2px 4px;font-size:12px;padding:3px 0;
  border-top:1px solid #2b313a}
.or .ck small{color:#aab3bd;font-size:12px;grid-column:2}
.or .ck small.do{color:#ffd08a}
.or .gate{font-size:13px;padding:2px 0 6px}
.or .last{border-radius:7px;background:#22272e;padding:6px 10px;font-size:13px;border-left:4px solid #8b949e}
.or .last.g{border-color:#3ddc84;color:#e6edf3}.or .last.o{border-color:#ff9f1c;color:#e6edf3}
.or .last.r{border-color:#ff5a52;color:#e6edf3}.or .last.b{border-color:#4aa8ff;color:#e6edf3}
.or .last small{float:right;color:#9aa4af}
[role=tab]{padding-left:7px!important;padding-right:7px!important}
.or .man{display:grid;grid-template-columns:64px 1fr;gap:8px;padding:6px 0;border-top:1px solid #2b313a}
.or .man small{display:block;font-size:12px;color:#c4ccd4}
.or .man i{font-style:normal;color:#9aa4af;font-size:12px}
.or .face{width:64px;height:64px;border-radius:7px;background:#22272e center/contain no-repeat}
.or .man .dot{display:inline-block;width:9px;height:9px;border-radius:50%;margin-right:5px}
.or-gone{position:fixed;left:0;top:0;right:0;z-index:9000;pointer-events:none;visibility:hidden;text-align:center;
  background:#b3261e;color:#fff;font:700 18px/1.3 system-ui,sans-serif;padding:10px;animation:or-gone .2s 3s forwards}
@keyframes or-gone{to{visibility:visible}}
"""


@dataclass(frozen=True)
class ButtonLook:
    """Size of a command button."""

    wide: bool = False
    """Whether it takes a whole row; else half of one."""
    height_px: int = 44
    """Height, CSS px; 44 and more is what a thumb hits."""


def style_html(buttons: Mapping[str, ButtonLook], panel_px: int) -> str:
    """The style sheet as HTML, with the page's buttons laid out as a grid of two columns that a thumb can hit.

    Args:
        buttons: element id to look of each command button, in reading order.
        panel_px: width of the panel; the alarms stand left of it, over the picture.
    """
    # Notes of the browser side take 20 em at the left; the alarms get the rest.
    rules = [_SHEET.replace("RIGHT", str(panel_px + 14)).replace("REST", str(panel_px + 350))]
    rules += [button_rules(element, look) for element, look in buttons.items()]
    return f"<style>{''.join(rules)}</style>"


def button_rules(element: str, look: ButtonLook) -> str:
    """Style rules of one button, by its element id."""
    button = f'button[id="{element}"]'
    return (
        f"div:has(>div>{button}){{padding:0 7px}}"
        f"div:has(>{button}){{display:inline-block;width:{'100%' if look.wide else '50%'};"
        "margin:0!important;padding:3px!important;vertical-align:top}"
        f"{button}{{height:{look.height_px}px!important;font-size:15px;padding:0 6px;border-radius:7px}}"
        f"{button} [data-position=left]{{margin:0 14px 0 -7px}}"
    )
