//! Self-contained HTML report of a log or of a simulated mission.
//!
//! `model` holds the contents of a page, filled from either source; `page` and `sections` render it with the
//! `deviation_picture`. `chart_samples` gives the charts of `assets/charts.js` their numbers; `assets/` has style and
//! scripts, and uPlot.

mod chart_samples;
mod deviation_picture;
pub mod model;
mod page;
mod replay_report;
mod sections;
mod text;

use deviation_picture::DeviationPicture;
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
    let compass = report.compasses.first().cloned().unwrap_or_default();
    DeviationPicture::new(&compass, report.reference.difference_name).file()
}
