"""CSS of a diagnosis page, in addition to the common report style."""

STYLE = """
:root { --first: #1f5fa8; --second: #2e9e6b; --third: #c2701c; --part: #8a93a0; --track: #eef0f2; }
@media (prefers-color-scheme: dark) {
  :root { --first: #6aa5e6; --second: #58c795; --third: #e8a35c; --part: #8a93a0;
    --track: #282c31; } }
body { overflow-wrap: break-word; }
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
.track .zero { width: 0; border-left: 1px solid var(--quiet); }
.track .whisker { top: 50%; height: 2px; margin-top: -1px; background: var(--ink);
  min-width: 2px; }
.track .line { top: -.16rem; height: calc(100% + .32rem); border-left: 2px dashed var(--ink); }
.value { font-variant-numeric: tabular-nums; }
.pairs, .threes { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: .9rem;
  margin: .5rem 0 1rem; align-items: start; }
.threes { grid-template-columns: repeat(3, minmax(0, 1fr)); }
.pairs { max-width: 58rem; }
.pairs figure, .threes figure { max-width: none; }
figure img { background: none; }
.sharp img { image-rendering: pixelated; }
.scale { max-width: 30rem; font-size: .86rem; color: var(--quiet); margin: 0 0 1.4rem; }
@media (max-width: 48rem) {
  .bars li { grid-template-columns: minmax(0, 1fr) auto; margin: .5rem 0; }
  .bars .track { grid-row: 2; grid-column: 1 / -1; height: .8rem; }
  .bars .value { text-align: right; }
  .track .line { top: 0; height: 100%; }
  .answer li { font-size: 1.08rem; }
  .pairs, .threes { grid-template-columns: minmax(0, 1fr); } }
"""
