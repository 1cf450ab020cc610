//! The page's look: a certificate, in the light, in the dark and on paper.

/// The style sheet. Every colour is a variable; the dark set stands in one place, paper is light.
pub const CSS: &str = r#"
:root {
  color-scheme: light dark;
  --paper: #ffffff; --ink: #1b1f23; --muted: #586069; --rule: #c9ced3; --grid: #e6e9ec;
  --m0: #b23a1e; --m1: #1d4d85; --third: #5d6b2f; --c3: #7d4a86; --c4: #94700f; --c5: #1d6a8a;
  --pass: #2a6a3a; --fail: #a8201a; --open: #805b00; --wash: #f5f6f7;
  --dot: #ffd84d; --target: #5fd0ff; --stray: #ff6b5e;
  --serif: Charter, "Bitstream Charter", "Sitka Text", Cambria, Georgia, "DejaVu Serif", serif;
  --sans: system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", "DejaVu Sans", sans-serif;
}
@media screen and (prefers-color-scheme: dark) {
  :root {
    --paper: #15181b; --ink: #e3e6e8; --muted: #9aa5af; --rule: #3c434a; --grid: #2a2f34;
    --m0: #f0906a; --m1: #83b6ee; --third: #b9c97e; --c3: #cf9dd8; --c4: #dcb75c; --c5: #6cc3dd;
    --pass: #7fcb91; --fail: #f2938b; --open: #dcb75c; --wash: #1d2125;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 15px/1.5 var(--sans);
  font-variant-numeric: tabular-nums lining-nums; }
main { max-width: 82rem; margin: 0 auto; padding: 2.5rem 1.5rem 4rem; }
header { border-bottom: 2px solid var(--ink); padding-bottom: 1rem; }
header p.kind { margin: 0; color: var(--muted); letter-spacing: .06em; text-transform: uppercase; font-size: .78rem; }
h1, h2, h3 { font-family: var(--serif); font-weight: 600; line-height: 1.25; }
h1 { font-size: 1.9rem; margin: .15rem 0 .9rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .8rem; padding-bottom: .25rem; border-bottom: 1px solid var(--rule); }
h3 { font-size: 1.02rem; margin: 1.6rem 0 .4rem; }
p { margin: .5rem 0; max-width: 46rem; }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1.2rem; margin: 0; }
dl.facts dt { color: var(--muted); }
dl.facts dd { margin: 0; overflow-wrap: anywhere; }
.verdict { margin: 1.6rem 0; padding: .2rem 0 .2rem 1.1rem; border-left: 5px solid var(--open); }
.verdict strong { display: block; font: 600 1.55rem/1.3 var(--serif); color: var(--open); }
.verdict.pass { border-color: var(--pass); } .verdict.pass strong { color: var(--pass); }
.verdict.fail, .verdict.error { border-color: var(--fail); }
.verdict.fail strong, .verdict.error strong { color: var(--fail); }
.verdict ul { margin: .2rem 0 0; padding: 0; list-style: none; }
.note, figcaption { color: var(--muted); font-size: .87rem; }
figure { margin: 1.1rem 0 1.6rem; }
figcaption { margin-top: .35rem; max-width: 46rem; }
.scroll, .plot { overflow-x: auto; }
table { border-collapse: collapse; font-size: .89rem; margin: .6rem 0; }
th, td { padding: .22rem .7rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--grid); vertical-align: baseline; }
thead th { border-bottom: 1px solid var(--ink); font-weight: 600; vertical-align: bottom; }
thead tr.group th { border-bottom: 1px solid var(--rule); text-align: center; }
tbody th { font-weight: 400; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td.text, th.text { text-align: left; white-space: normal; }
th.first, td.first { padding-left: 2.2rem; }
table.full { width: 100%; }
table.wide { font-size: .78rem; } .wide :is(th, td):not(:first-child) { padding-left: .25rem; padding-right: .38rem; }
td.name { text-align: left; }
td.u, th.u { color: var(--muted); }
th.m0 { color: var(--m0); } th.m1 { color: var(--m1); } th.m2 { color: var(--third); }
details { margin: .7rem 0; }
summary { cursor: pointer; font-weight: 600; }
summary span { color: var(--muted); font-weight: 400; }
pre { background: var(--wash); border: 1px solid var(--grid); padding: .8rem 1rem; overflow-x: auto; font-size: .8rem; line-height: 1.45; }
code { font-size: .87em; overflow-wrap: anywhere; }
ul.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.4rem; margin: 0 0 .3rem; padding: 0; list-style: none; font-size: .87rem; }
ul.legend svg.key { width: 28px; height: 14px; vertical-align: -2px; margin-right: .45rem; }
svg { display: block; font-family: var(--sans); }
ul.legend svg { display: inline-block; }
.plot svg { width: 100%; min-width: 560px; height: auto; }
.grid line { stroke: var(--grid); stroke-width: 1; }
.axis line { stroke: var(--ink); stroke-width: 1; }
.ticks text { fill: var(--muted); font-size: 12px; }
.names text { fill: var(--ink); font-size: 12.5px; }
.s0 { color: var(--m0); } .s1 { color: var(--m1); } .s2 { color: var(--third); } .s3 { color: var(--muted); } .s4 { color: var(--m0); } .s5 { color: var(--m1); }
.s0 :is(circle, rect), .s1 :is(circle, rect), .s2 :is(circle, rect), .s3 :is(circle, rect), .s4 :is(circle, rect), .s5 :is(circle, rect) { fill: currentColor; }
.c0 { color: var(--m0); } .c1 { color: var(--m1); } .c2 { color: var(--third); } .c3 { color: var(--c3); } .c4 { color: var(--c4); } .c5 { color: var(--c5); }
:is(.c0, .c1, .c2, .c3, .c4, .c5) :is(circle, rect) { fill: currentColor; }
:is(.c0, .c1, .c2, .c3, .c4, .c5) circle.ring { fill: var(--paper); stroke: currentColor; stroke-width: 1.6; }
th svg.key { display: inline-block; width: 14px; height: 14px; vertical-align: -2px; }
.faint { opacity: .42; }
:is(.s0, .s1, .s2, .s3, .s4, .s5) circle.ring { fill: none; stroke: currentColor; stroke-width: 1.3; }
.bars path { fill: none; stroke: currentColor; stroke-width: 1.4; }
.line polyline { fill: none; stroke: currentColor; stroke-width: 1.4; stroke-linejoin: round; }
.fit polyline, .fit line { fill: none; stroke: currentColor; stroke-width: 1.1; stroke-dasharray: 6 3; opacity: .85; }
.zero line { stroke: var(--ink); stroke-width: 1; }
.limit line { stroke: var(--fail); stroke-width: 1.2; stroke-dasharray: 2 3; }
.limit text { fill: var(--fail); font-size: 12px; }
.band rect { fill: var(--pass); opacity: .16; }
.mark line { stroke: var(--pass); stroke-width: 1.2; stroke-dasharray: 5 3; } .mark text { fill: var(--pass); font-size: 12px; }
.hop line { stroke: var(--fail); stroke-width: 1.1; } .hop text { fill: var(--fail); font-size: 12px; }
.course polyline, .course line { fill: none; stroke: currentColor; stroke-width: 1.6; stroke-linejoin: round; }
.picture svg { width: 100%; height: auto; background: #000; }
.picture circle, .picture path, .picture ellipse { fill: none; vector-effect: non-scaling-stroke; }
.picture .dot, ul.legend .dot circle { stroke: var(--dot); stroke-width: 1; fill: none; }
.picture .rejected, ul.legend .rejected circle { stroke: var(--stray); stroke-width: 1.2; stroke-dasharray: 2 2; fill: none; }
.picture .target, ul.legend .target circle { stroke: var(--target); stroke-width: 1.5; fill: none; }
.picture .stray, ul.legend .stray path { stroke: var(--stray); stroke-width: 1.3; fill: none; }
.picture text { font-size: 15px; font-weight: 600; paint-order: stroke; stroke: #000; stroke-width: 3.5px; stroke-linejoin: round; }
.picture text.of-dot { fill: var(--dot); } .picture text.of-target { fill: var(--target); }
ul.legend.on-picture li { display: flex; align-items: center; }
ul.legend.on-picture svg.key { background: #2b2b2b; border-radius: 2px; }
.fields { display: grid; grid-template-columns: repeat(auto-fit, minmax(250px, 1fr)); gap: 1rem 1.2rem; }
.fields figure { margin: 0; }
.fields svg { width: 100%; height: auto; }
.field .frame { fill: none; stroke: var(--rule); }
.field .arrow { stroke: var(--m1); stroke-width: 1.3; fill: none; }
.field .arrow.of-target { stroke: var(--third); stroke-width: 1.8; }
.field .arrow.rejected { stroke: var(--fail); stroke-dasharray: 3 2; }
.field .foot { fill: var(--muted); }
.field .bar { stroke: var(--ink); stroke-width: 1.4; fill: none; }
.field text { fill: var(--ink); font-size: 15px; }
.coverage svg { width: 100%; max-width: 34rem; height: auto; }
.coverage rect { fill: var(--m1); stroke: var(--rule); stroke-width: 1; }
.coverage text { fill: var(--ink); font-size: 12px; }
td.high { color: var(--m0); font-weight: 600; }
.stages rect { stroke: var(--paper); stroke-width: 1; }
.t0 { fill: #8a949e; } .t1 { fill: #1d6a8a; } .t2 { fill: #b98a1f; } .t3 { fill: #7d4a86; }
.stages svg { width: 100%; height: 26px; }
@media (max-width: 40rem) {
  main { padding: 1.4rem 1rem 3rem; }
  h1 { font-size: 1.5rem; }
  table.keys { font-size: .82rem; } .keys th, .keys td { white-space: normal; padding-left: .35rem; padding-right: .35rem; }
  dl.facts { grid-template-columns: 1fr; } dl.facts dd { margin-bottom: .35rem; }
}
@media print {
  body { font-size: 10pt; } main { max-width: none; padding: 0; }
  figure, .verdict, tr { break-inside: avoid; } h2, h3, summary { break-after: avoid; }
  .scroll, .plot { overflow: visible; } .plot svg { min-width: 0; }
  details::details-content { content-visibility: visible; block-size: auto; }
  pre { white-space: pre-wrap; } .picture, ul.legend, .stages { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  .wide { font-size: 7.5pt; } .wide th, .wide td { padding: .1rem .28rem; }
}
"#;
