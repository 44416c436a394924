"""Inline style of reports, light or dark as the reader's system."""

STYLE = """
:root { color-scheme: light dark; --page: #fbfbfa; --card: #ffffff; --ink: #23262b;
  --quiet: #626972; --line: #dfe2e6; --accent: #1f5fa8; --warn: #9a4a00; --warn-back: #fff3e2;
  --plus: 178, 24, 43; --minus: 33, 102, 172;
  --first: #1f5fa8; --second: #2e9e6b; --third: #c2701c; --part: #8a93a0; --track: #eef0f2; }
@media (prefers-color-scheme: dark) {
  :root { --page: #15171a; --card: #1d2024; --ink: #e4e6e9; --quiet: #9aa1aa; --line: #343941;
    --accent: #7fb4ee; --warn: #ffb868; --warn-back: #38290f;
    --plus: 235, 96, 96; --minus: 92, 156, 225;
    --first: #6aa5e6; --second: #58c795; --third: #e8a35c; --track: #282c31; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); overflow-wrap: break-word;
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 76rem; margin: 0 auto; padding: 2.5rem 1.25rem 4rem; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .6rem; letter-spacing: -.01em; }
h2 { font-size: 1.35rem; margin: 3rem 0 .6rem; padding-top: 1.1rem;
  border-top: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .5rem; }
h4 { font-size: .95rem; margin: 1.2rem 0 .4rem; color: var(--quiet); font-weight: 600; }
p, li { max-width: 46rem; }
p { margin: .5rem 0 .9rem; }
a { color: var(--accent); }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin: 1rem 0 0; font-size: .95rem; }
code { font: .9em/1.4 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace;
  overflow-wrap: anywhere; }
.quiet { color: var(--quiet); font-size: .92rem; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(11.5rem, 1fr)); gap: .8rem;
  margin: 1.6rem 0 .6rem; padding: 0; }
.facts div { background: var(--card); border: 1px solid var(--line); border-radius: 8px;
  padding: .8rem 1rem; }
.facts dt { color: var(--quiet); font-size: .85rem; }
.facts dd { margin: .1rem 0 0; font-size: 1.5rem; font-weight: 600; line-height: 1.25;
  font-variant-numeric: tabular-nums; }
.facts dd small { display: block; font-size: .82rem; font-weight: 400; color: var(--quiet); }
.open { background: var(--warn-back); border-left: 4px solid var(--warn); border-radius: 4px;
  padding: .7rem 1rem .7rem 2.2rem; margin: .8rem 0; }
.open li + li { margin-top: .4rem; }
.scroll { overflow-x: auto; margin: .6rem 0 1rem; border: 1px solid var(--line);
  border-radius: 8px; background: var(--card); }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
th, td { padding: .38rem .55rem; text-align: left; vertical-align: baseline;
  border-bottom: 1px solid var(--line); white-space: nowrap; }
tbody tr:last-child > * { border-bottom: 0; }
thead th { color: var(--quiet); font-weight: 600; font-size: .84rem; vertical-align: bottom; }
tbody th { font-weight: 400; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
.loose { color: var(--warn); }
.total > * { font-weight: 600; border-top: 2px solid var(--line); }
.matrix { width: auto; font-size: .78rem; }
.matrix th, .matrix td { padding: .18rem .25rem; border: 1px solid var(--line);
  font-variant-numeric: tabular-nums; }
.matrix td { text-align: center; min-width: 2.4rem; }
.matrix thead th { text-align: center; }
.matrix tbody th { position: sticky; left: 0; background: var(--card); }
.pairs, .threes { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: .9rem;
  margin: .5rem 0 1rem; align-items: start; }
.threes { grid-template-columns: repeat(3, minmax(0, 1fr)); }
figure { margin: 0; }
figure .frame { position: relative; display: block; line-height: 0; }
figure img { width: 100%; height: auto; border-radius: 4px; }
.sharp img { image-rendering: pixelated; }
figure .crop { position: absolute; border: 1.5px solid #ffd23f; border-radius: 1px;
  box-shadow: 0 0 0 1px rgba(0, 0, 0, .5); }
figcaption { font-size: .86rem; color: var(--quiet); margin-top: .3rem; }
figcaption b { color: var(--ink); font-weight: 600; }
.bar { display: flex; align-items: center; gap: .5rem; font-variant-numeric: tabular-nums; }
.bar img { flex: 1; height: .7rem; min-width: 0; border-radius: 2px; }
.swatch { display: inline-block; width: .8em; height: .8em; border-radius: 2px; }
.verdict { color: var(--accent); font-size: 1.15rem; font-weight: 600; margin: 0 0 .4rem; }
.answer { list-style: none; margin: 1.1rem 0 1.2rem; padding: 0; }
.answer li { font-size: 1.2rem; line-height: 1.5; max-width: 62rem; margin: 0 0 .8rem;
  padding-left: .9rem; border-left: 3px solid var(--line); }
.answer b { display: block; color: var(--quiet); font-size: .82rem; font-weight: 600;
  letter-spacing: .04em; }
.bars { list-style: none; margin: .4rem 0 1.1rem; padding: 0; max-width: 62rem; }
.bars li { display: grid; grid-template-columns: 16rem minmax(0, 1fr) 15rem; gap: 0 .9rem;
  align-items: center; max-width: none; margin: .16rem 0; font-size: .92rem; line-height: 1.35; }
.track { position: relative; height: 1rem; background: var(--track); border-radius: 2px; }
.track i { position: absolute; top: 0; height: 100%; }
.first { background: var(--first); } .second { background: var(--second); }
.third { background: var(--third); } .part { background: var(--part); }
.part0 { background: #4a7fb5; } .part1 { background: #d1495b; } .part2 { background: #8d5fa8; }
.part3 { background: #e0a030; } .part4 { background: #b59a6a; } .part5 { background: #5b8e7d; }
.part6 { background: #8a93a0; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.2rem; font-size: .86rem; max-width: 62rem; }
.track .zero { width: 0; border-left: 1px solid var(--quiet); }
.track .whisker { top: 50%; height: 2px; margin-top: -1px; background: var(--ink);
  min-width: 2px; }
.track .line { top: -.16rem; height: calc(100% + .32rem); border-left: 2px dashed var(--ink); }
.value { font-variant-numeric: tabular-nums; }
.scale { max-width: 30rem; font-size: .86rem; color: var(--quiet); margin: 0 0 1.4rem; }
@media (max-width: 48rem) {
  .bars li { grid-template-columns: minmax(0, 1fr) auto; margin: .5rem 0; }
  .bars .track { grid-row: 2; grid-column: 1 / -1; height: .8rem; }
  .bars .value { text-align: right; }
  .track .line { top: 0; height: 100%; }
  .answer li { font-size: 1.08rem; }
  .pairs, .threes { grid-template-columns: minmax(0, 1fr); } }
details { margin: .8rem 0; }
summary { cursor: pointer; color: var(--accent); }
@media print { .scroll { overflow: visible; } h2 { break-after: avoid; }
  figure { break-inside: avoid; } }
"""
