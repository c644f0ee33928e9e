//! Files named on the command line: logs, airframes, reports.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LogError, LogVisitor};
use log_analysis::report::{self, Report};
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;

use crate::command_failure::CommandFailure;

/// Visits each log of a file, of the tables in a folder, or of standard input if the path is `-`, by its path: that of the
/// file or folder, followed by the log's name if it holds several. Such a path visits that log alone. `unit` is the unit of
/// a table's field, `system` the MAVLink system to read (default: the first autopilot).
///
/// # Errors
///
/// The file cannot be read, or holds no log of this name.
pub fn visit_logs(
    path: &Path,
    unit: FieldUnit,
    system: Option<u8>,
    visit: &mut LogVisitor<'_>,
) -> Result<(), LogError> {
    let as_source = |file| {
        let tables = if Path::is_file(file) { Vec::new() } else { table_files(file) };
        (file.is_file() || !tables.is_empty()).then_some((file, tables))
    };
    let (file, tables) = path.ancestors().find_map(as_source).unwrap_or((path, Vec::new()));
    let mut names = Vec::new();
    let mut is_found = file == path;
    let mut visit_log = |name: &str, flight| {
        let log_path = if name.is_empty() { file.display().to_string() } else { format!("{}/{name}", file.display()) };
        if file == path || file.join(name) == path {
            is_found = true;
            visit(&log_path, flight);
        } else {
            names.push(log_path);
        }
    };
    if file.is_dir() {
        log::visit_folder(&mut |visit| read_files(&tables, visit), unit, &mut visit_log)?;
    } else {
        let mut source: Box<dyn Read> =
            if path.as_os_str() == "-" { Box::new(io::stdin().lock()) } else { Box::new(File::open(file)?) };
        log::visit_flights(&mut *source, unit, system, &mut visit_log)?;
    }
    if is_found { Ok(()) } else { Err(LogError::NoLogOfName(names)) }
}

/// The files of a folder that are tables of one log, sorted by name; none of a folder that cannot be read.
#[must_use]
pub fn table_files(folder: &Path) -> Vec<PathBuf> {
    let is_table = |path: &PathBuf| {
        let is_csv = path.extension().is_some_and(|extension| extension == "csv") && path.is_file();
        is_csv
            && File::open(path).and_then(|mut file| log::is_table_of_log(&file_name(path), &mut file)).unwrap_or(false)
    };
    let entries = fs::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_table).collect();
    files.sort();
    files
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn read_files(files: &[PathBuf], visit: &mut log::EntryVisitor<'_>) -> io::Result<()> {
    files.iter().try_for_each(|path| visit(file_name(path), &mut File::open(path)?))
}

/// World for `table1`, `random`, or the path of an airframe file.
///
/// # Errors
///
/// The file cannot be read or parsed, or a number is out of range.
pub fn named_world(name: &str, seed: u64) -> Result<WorldConfig, CommandFailure> {
    match name {
        "table1" => Ok(WorldConfig::of_table1(seed)),
        "random" => Ok(WorldConfig::random_world(seed)),
        path => {
            let text = fs::read_to_string(path).map_err(|error| {
                let kinds = VehicleKind::ALL_VEHICLES.map(VehicleKind::vehicle_name).join("`, `");
                CommandFailure(format!(
                    "airframe-unreadable: {path}: {error} (expected `{kinds}`, `table1`, `random` or an airframe file)"
                ))
            })?;
            WorldConfig::from_toml(&text, seed)
                .map_err(|error| CommandFailure(format!("{}: {path}: {error}", error.stable_code())))
        }
    }
}

/// File name extensions that are rejected for a report, unless a folder of that name exists.
const NON_REPORT_EXTENSIONS: [&str; 10] = ["pdf", "png", "jpg", "json", "csv", "txt", "md", "xml", "param", "docx"];

/// Writes the page to a file (`index.html` if `path` is a folder), or the before-and-after picture to a `.svg` file.
/// Creates the last folder of the path and returns the file's path. Equal reports give equal bytes.
///
/// # Errors
///
/// The file cannot be written, or its name ends as that of another kind of file.
pub fn write_report_file(report: &Report, path: &Path) -> io::Result<PathBuf> {
    let has_extension_of = |extensions: &[&str]| {
        path.extension().is_some_and(|extension| {
            extensions.iter().any(|extension_in_list| extension.eq_ignore_ascii_case(extension_in_list))
        })
    };
    let is_file = has_extension_of(&["html", "htm", "svg"]) && !path.is_dir();
    if !is_file && !path.is_dir() && has_extension_of(&NON_REPORT_EXTENSIONS) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "a report is .html or .svg"));
    }
    let file = if is_file { path.to_owned() } else { path.join("index.html") };
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        fs::create_dir(folder).map_err(|error| io::Error::new(error.kind(), missing_folder(folder, &error)))?;
    }
    fs::write(
        &file,
        if is_file && has_extension_of(&["svg"]) {
            report::render_picture(report)
        } else {
            report::render_page(report)
        },
    )?;
    Ok(file)
}

/// Why a folder was not created: its own parent is missing.
fn missing_folder(folder: &Path, error: &io::Error) -> String {
    match folder.parent().filter(|parent| !parent.as_os_str().is_empty() && !parent.is_dir()) {
        Some(parent) => format!("the folder {} does not exist", parent.display()),
        None => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_written_to_the_given_path() {
        let folder = tempfile::tempdir().unwrap();
        let report = Report::default();
        let write_report_at = |name: &str| write_report_file(&report, &folder.path().join(name)).unwrap();
        assert_eq!(write_report_at("new"), folder.path().join("new/index.html"));
        assert_eq!(write_report_at("page.HTML"), folder.path().join("page.HTML"));
        assert_eq!(write_report_at("deep/page.html"), folder.path().join("deep/page.html"));
        let missing = write_report_file(&report, &folder.path().join("none/of/these/page.html")).unwrap_err();
        assert!(missing.to_string().ends_with("none/of does not exist"), "{missing}");
        assert!(!folder.path().join("none").exists());
        fs::create_dir(folder.path().join("odd.html")).unwrap();
        assert_eq!(write_report_at("odd.html"), folder.path().join("odd.html/index.html"));
        let pdf = folder.path().join("page.pdf");
        assert!(write_report_file(&report, &pdf).is_err() && !pdf.exists());
        fs::create_dir(&pdf).unwrap();
        assert_eq!(write_report_at("page.pdf"), pdf.join("index.html"));
        let picture = fs::read_to_string(write_report_at("only.svg")).unwrap();
        assert!(picture.starts_with("<svg"));
        assert!(fs::read_to_string(write_report_at("page.html")).unwrap().starts_with("<!doctype html>"));
    }
}
