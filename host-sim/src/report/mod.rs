//! The report: one page that needs nothing else, of a simulated mission or of a log.
//!
//! | file | holds |
//! |---|---|
//! | `model.rs` | what a page shows, wherever it comes from |
//! | `of_mission.rs`, `of_replay.rs` | that of a mission and of a replayed log |
//! | `page.rs`, `sections.rs` | the page |
//! | `pictures/` | its pictures, a file each |
//! | `frame.rs`, `svg.rs`, `text.rs` | axes, shapes, words and numbers |
//! | `assets/` | style and script |

mod frame;
mod model;
mod of_mission;
mod of_replay;
mod page;
mod pictures;
mod sections;
mod svg;
#[cfg(test)]
mod tests;
mod text;

pub use model::Report;
pub use of_mission::of_mission;
pub use of_replay::of_replay;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// What a report is made of besides its flight.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// The command line.
    pub command: String,
    /// What was set, and to what.
    pub settings: Vec<[String; 2]>,
    /// What the command printed.
    pub printed: String,
    /// Name and text of a file of parameters to load.
    pub parameters: Option<[String; 2]>,
}

/// Writes the page into a file, `index.html` if `path` is a folder's; of a `.svg` the picture of before and after alone.
/// Folders are made. Gives the file. The same report writes the same bytes.
///
/// # Errors
///
/// What the file system says.
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

/// The page.
#[must_use]
pub fn page(report: &Report) -> String {
    page::page(report)
}

/// Before and after as a picture of its own, of the compass that matters most.
#[must_use]
pub fn picture(report: &Report) -> String {
    let Some(compass) = report.foremost() else { return svg::Svg::new(1.0, 1.0).file("nothing", "") };
    let picture = pictures::swing::both(compass, report.compared.word);
    picture.svg.file(&picture.title, &picture.words)
}
