//! Self-contained HTML report of a simulated mission or a log.
//!
//! `model` holds the contents of a page, filled from either source; `page` and `sections` render it with the
//! `pictures`; `frame`, `svg` and `text` are their building blocks; `assets/` has style and script.

mod frame;
mod mission_report;
mod model;
mod page;
mod pictures;
mod replay_report;
mod sections;
mod svg;
#[cfg(test)]
mod tests;
mod text;

pub use mission_report::report_mission;
pub use model::Report;
pub use replay_report::report_replay;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Origin of a report, besides its flight.
#[derive(Clone, Debug, Default)]
pub struct ReportOrigin {
    /// Command line.
    pub command: String,
    /// Settings, name and value.
    pub settings: Vec<[String; 2]>,
    /// Output of the command.
    pub terminal_output: String,
    /// Name and text of a parameter file.
    pub parameters: Option<[String; 2]>,
}

/// Writes the page to a file (`index.html` if `path` is a folder), or the before-and-after picture to a `.svg` file.
/// Creates folders and returns the file's path. Equal reports give equal bytes.
///
/// # Errors
///
/// The file cannot be written.
pub fn write(report: &Report, path: &Path) -> io::Result<PathBuf> {
    let ends_with = |ends: &[&str]| {
        path.extension().is_some_and(|extension| ends.iter().any(|end| extension.eq_ignore_ascii_case(end)))
    };
    let is_file = ends_with(&["html", "htm", "svg"]) && !path.is_dir();
    let file = if is_file { path.to_owned() } else { path.join("index.html") };
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)?;
    }
    fs::write(&file, if is_file && ends_with(&["svg"]) { picture(report) } else { page(report) })?;
    Ok(file)
}

/// Renders the page.
#[must_use]
pub fn page(report: &Report) -> String {
    page::render_html(report)
}

/// Renders the before-and-after picture of the foremost compass as an SVG file.
#[must_use]
pub fn picture(report: &Report) -> String {
    let Some(compass) = report.main_compass() else { return svg::Svg::new(1.0, 1.0).to_file("nothing", "") };
    let picture = pictures::deviation::combined_picture(compass, report.reference.difference_name);
    picture.svg.to_file(&picture.title, &picture.description)
}
