//! Self-contained HTML report of a log or of a simulated mission.
//!
//! `model` holds the contents of a page, filled from either source; `page` and `sections` render it with the
//! `pictures`; `frame`, `svg` and `text` are building blocks. `chart_samples` gives the charts of `assets/charts.js`
//! their numbers; `assets/` has style and scripts, and uPlot.

mod chart_samples;
mod frame;
pub mod model;
mod page;
mod pictures;
mod replay_report;
mod sections;
mod svg;
mod text;

pub use model::{Report, ReportOrigin};
pub use replay_report::report_replay;

/// Renders the report as one HTML page.
#[must_use]
pub fn render_page(report: &Report) -> String {
    page::render_html(report)
}

/// Renders the before-and-after picture of the first compass as an SVG file.
#[must_use]
pub fn render_picture(report: &Report) -> String {
    let Some(compass) = report.compasses.first() else { return svg::Svg::new(1.0, 1.0).to_file("nothing", "") };
    let picture = pictures::deviation::combined_picture(compass, report.reference.difference_name);
    picture.svg.to_file(&picture.title, &picture.description)
}
