//! The mission's report: pictures, and a page that holds them and the numbers.

mod page;
mod pictures;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::mission::Flown;

/// Writes `index.html` (which needs no other file), `ellipses.svg`, `errors.svg` and `before-after.svg` into a
/// directory, which is made if it is not there; gives their paths. The same mission writes the same bytes.
///
/// # Errors
///
/// What the file system says.
pub fn write(flown: &Flown, directory: &Path) -> io::Result<Vec<PathBuf>> {
    let ellipses = pictures::ellipses(flown).map_err(io::Error::other)?;
    let errors = pictures::errors(flown).map_err(io::Error::other)?;
    let page = page::page(flown, &ellipses, &errors);
    let before_after = pictures::before_after(flown).map_err(io::Error::other)?;
    fs::create_dir_all(directory)?;
    let files =
        [("index.html", page), ("ellipses.svg", ellipses), ("errors.svg", errors), ("before-after.svg", before_after)];
    files
        .into_iter()
        .map(|(name, contents)| {
            let path = directory.join(name);
            fs::write(&path, contents)?;
            Ok(path)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission::{Plan, fly};
    use crate::world::WorldConfig;

    fn written(flown: &Flown, name: &str) -> Vec<(String, String)> {
        let directory = std::env::temp_dir().join(format!("autoswing-report-{}-{name}", std::process::id()));
        let files = write(flown, &directory)
            .unwrap()
            .into_iter()
            .map(|path| {
                let contents = fs::read_to_string(&path).unwrap();
                (path.file_name().unwrap().to_string_lossy().into_owned(), contents)
            })
            .collect();
        fs::remove_dir_all(&directory).unwrap();
        files
    }

    #[test]
    fn a_calibrated_mission_is_reported_the_same_each_time() {
        let flown = fly(WorldConfig::table1(1), Plan::default(), &mut |_, _| {});
        let files = written(&flown, "first");
        assert_eq!(files, written(&flown, "second"));
        for (name, contents) in &files {
            let end = if name == "index.html" { "</html>\n" } else { "</svg>\n" };
            assert!(contents.ends_with(end), "{name}");
        }
        let page = &files[0].1;
        let worst = format!("{:.2}", flown.after.figures().max_deg);
        assert!(page.contains(&worst) && page.contains("maximum-likelihood"), "the numbers are on the page");
        assert!(!page.contains('\u{1b}'), "terminal control sequences are not");
        assert!(
            !page.contains("http://") || page.matches("http://").count() == page.matches("http://www.w3.org").count()
        );
    }

    #[test]
    fn a_refusal_is_reported_with_its_reason() {
        let flown = fly(WorldConfig::table1(1), Plan { bank_deg: 25.0, circles: 0.05 }, &mut |_, _| {});
        let page = written(&flown, "refused").remove(0).1;
        assert!(page.contains("too-few-samples"), "the code is on the page");
    }
}
