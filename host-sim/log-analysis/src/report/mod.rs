//! Self-contained HTML report of a log or of a simulated mission.
//!
//! `model` holds the contents of a page, filled from either source; it is rendered by `sections` and
//! `deviation_picture`. `chart_samples` gives the charts of `assets/charts.js` their numbers; `assets/` has style and
//! scripts, and uPlot.

mod chart_samples;
mod deviation_picture;
pub mod model;
mod replay_report;
mod sections;
mod text;

use deviation_picture::{DeviationPicture, style_css};
use text::{concat_map, escape_html};

pub use model::{Report, ReportOrigin};
pub use replay_report::report_replay;

/// Renders the before-and-after picture of the first compass as an SVG file.
#[must_use]
pub fn render_picture(report: &Report) -> String {
    let compass = report.compasses.first().cloned().unwrap_or_default();
    DeviationPicture::new(&compass, report.reference.difference_name).file()
}

const STYLE: &str = include_str!("assets/page.css");
const SCRIPT: &str = concat!(
    include_str!("assets/copy.js"),
    include_str!("assets/compasses.js"),
    "/*\n",
    include_str!("assets/uplot/LICENSE"),
    "*/\n",
    include_str!("assets/uplot/uPlot.iife.min.js"),
    include_str!("assets/charts.js")
);
const CHART_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");

/// Content security policy: inline style, this script by its checksum, no network. scripts/page fails if the checksum
/// is outdated.
const CONTENT_SECURITY_POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-qnffCWyoD19V4GtW2Xk72+0t38sRje6NkLJU/yNxdjg='";

/// Renders the report as one HTML page.
#[must_use]
pub fn render_page(report: &Report) -> String {
    let sections_html = concat_map(page_sections(report), |PageSection { id, title, html, is_folded }| {
        let heading = format!("<h2 id=\"{id}\">{title}</h2>");
        let content = if is_folded {
            format!("<details><summary>{heading}</summary>\n{html}</details>\n")
        } else {
            format!("{heading}\n{html}")
        };
        format!("<section aria-labelledby=\"{id}\">\n{content}</section>\n")
    });
    let title = escape_html(&report.title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{CONTENT_SECURITY_POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} - Autoswing</title>\n\
         <style>\n{}{CHART_STYLE}\n{STYLE}</style></head>\n<body>\n<a class=\"skip\" href=\"#verdict\">Skip to the verdict</a>\n\
         <header><p class=\"brand\">Autoswing</p><h1>{title}</h1></header>\n<main>\n{sections_html}</main>\n\
         <script>{SCRIPT}</script>\n</body></html>\n",
        style_css()
    )
}

struct PageSection {
    id: &'static str,
    title: &'static str,
    html: String,
    is_folded: bool,
}

/// Parts of the page; folded ones have what a pilot needs less often, the figures last.
fn page_sections(report: &Report) -> Vec<PageSection> {
    let folded = |id, title, html| PageSection { id, title, html, is_folded: true };
    [
        PageSection { id: "verdict", title: "Verdict", html: sections::verdict_section(report), is_folded: false },
        folded("parameters", "Parameters, old and new", sections::parameters_section(report)),
        folded("charts", "Charts", sections::charts_section(report)),
        folded("card", "Deviation card", sections::cards_section(report)),
        folded("log", "About this flight", sections::origin_section(report)),
        folded("figures", "All figures", sections::figures_section(report)),
    ]
    .into_iter()
    .filter(|section| !section.html.is_empty())
    .collect()
}
