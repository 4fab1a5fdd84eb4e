//! What the reports' pages share: they need no network, fit narrow screens and paper, and are dark where the
//! reader's system is.

use graintrain_view::plot::svg::escape;

const STYLE: &str = "\
:root{color-scheme:light dark;--ground:#fff;--text:#222;--faint:#5c6570;--line:#ccd2d9;--panel:#f2f4f7;--good:#00693e;--bad:#b00020;--open:#8a5a00}
@media(prefers-color-scheme:dark){:root{--ground:#14171c;--text:#e6e9ee;--faint:#9aa4b0;--line:#343b45;--panel:#23272f;--good:#56d394;--bad:#ff8a80;--open:#e3b341}}
body{font:15px/1.5 system-ui,sans-serif;max-width:1330px;margin:2em auto;padding:0 1em;color:var(--text);background:var(--ground)}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}small,figcaption,.source{color:var(--faint)}.source{font-size:13px;margin:.1em 0}code{font-size:13px}
table{display:block;max-width:100%;overflow-x:auto;border-collapse:collapse;margin:1em 0;font-size:14px}
td,th{padding:.25em .7em;border-bottom:1px solid var(--line);text-align:left;vertical-align:top}th{border-bottom:2px solid var(--line);background:var(--panel)}
td.n,.numbers td,.numbers th{text-align:right;font-variant-numeric:tabular-nums}td.n{white-space:nowrap}
figure{margin:18px 0}svg,img{max-width:100%;height:auto;background:#fff}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(420px,100%),1fr));gap:12px}
.holds,.passed{color:var(--good)}.fails,.failed{color:var(--bad)}.open,.undecided{color:var(--open)}.left{color:var(--faint)}.holds,.fails,.open,.failed{font-weight:bold}
@media print{body{max-width:none;margin:0;font-size:10pt}table{display:table;font-size:8pt}h2{break-after:avoid}tr{break-inside:avoid}}";

/// A page up to its first heading, which is its title; `</body></html>` ends it.
pub(crate) fn begin(title: &str) -> String {
    let title = escape(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
         <title>{title}</title>\n<style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n"
    )
}
