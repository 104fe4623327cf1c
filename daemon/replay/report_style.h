// The report's style sheet: light and dark, no outside resource.
#pragma once

#include <string_view>

namespace lampglow::daemon {

inline constexpr std::string_view kReportStyle = R"(
:root { color-scheme: light dark; --ground: #ffffff; --ink: #1f2328; --soft: #656d76; --line: #d8dee4;
  --estimate: #0969da; --band: #0969da26; --truth: #bc4c00; --fog: #8250df; --fit: #cf222e; --panel: #f6f8fa; }
@media (prefers-color-scheme: dark) { :root { --ground: #0d1117; --ink: #e6edf3; --soft: #8d96a0; --line: #30363d;
  --estimate: #58a6ff; --band: #58a6ff33; --truth: #f0883e; --fog: #a371f7; --fit: #ff7b72; --panel: #161b22; } }
body { background: var(--ground); color: var(--ink); font: 15px/1.5 system-ui, sans-serif; margin: 0 auto;
  max-width: 1000px; padding: 1.5rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; } .soft, figcaption { color: var(--soft); }
svg { width: 100%; height: auto; display: block; } .tick { fill: var(--soft); font-size: 11px; }
.grid { stroke: var(--line); } .fog { stroke: var(--fog); stroke-dasharray: 5 4; }
.band { fill: var(--band); } .bandline { stroke: var(--band); stroke-width: 5; }
.estimate { fill: none; stroke: var(--estimate); stroke-width: 1.5; } .dot, .limit { fill: var(--estimate); }
.dot.contrast { fill: var(--ground); stroke: var(--estimate); stroke-width: 1.4; }
.truth { fill: none; stroke: var(--truth); stroke-width: 1.5; } .truthdot { fill: var(--truth); }
.bar { stroke: var(--estimate); } .ring { fill: var(--estimate); }
.fit { fill: none; stroke: var(--fit); stroke-width: 1.5; }
.key { display: flex; flex-wrap: wrap; gap: .3rem 1.4rem; color: var(--soft); font-size: .9rem; }
.key i { display: inline-block; width: 1.1em; height: .7em; margin-right: .4em; border-radius: 2px; }
table { border-collapse: collapse; font-size: .9rem; } .wide { overflow-x: auto; }
th, td { padding: .2rem .7rem; text-align: right; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child, .left { text-align: left; }
figure { margin: 0 0 1rem; } figure img { width: 100%; height: auto; border-radius: 6px; display: block; }
.profiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(260px, 1fr)); gap: .8rem; }
.profiles figure { background: var(--panel); border-radius: 6px; padding: .5rem; }
)";

}  // namespace lampglow::daemon
