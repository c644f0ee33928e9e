//! The page.

use std::fmt::Write as _;

use crate::mission::Flown;
use crate::score::Figures;
use crate::transcript::{Notice, Shown};

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:920px;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse}td,th{padding:.15em .8em;text-align:right;border-bottom:1px solid #ddd}\
th:first-child,td:first-child{text-align:left}pre{background:#f5f5f5;padding:1em;overflow:auto;font-size:13px}\
svg{max-width:100%;height:auto}";

/// The whole page, with the pictures in it.
pub fn page(flown: &Flown, ellipses: &str, errors: &str) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Autoswing mission, seed {seed}</title>\
         <style>{STYLE}</style></head><body>\n<h1>Mission, seed {seed}</h1>\n",
        seed = flown.world.seed
    );
    // Writing to a string never fails.
    let _ = body(&mut html, flown, ellipses, errors);
    html.push_str("</body></html>\n");
    html
}

fn body(html: &mut String, flown: &Flown, ellipses: &str, errors: &str) -> std::fmt::Result {
    writeln!(html, "<p>{}</p>", escaped(&verdict(flown)))?;
    figures_table(html, flown)?;
    writeln!(html, "<h2>Heading error</h2>\n{errors}")?;
    writeln!(
        html,
        "<h2>Field in the routine, levelled</h2>\n<p>An uncalibrated compass sees ellipses off the centre; what the \
         calibration makes of them is the Earth's field, one circle.</p>\n{ellipses}"
    )?;
    errors_table(html, flown)?;
    if let Ok(shown) = &flown.result {
        coefficients(html, shown)?;
    }
    writeln!(html, "<h2>Console session</h2>\n<pre>{}</pre>", escaped(&plain(&flown.session)))
}

fn verdict(flown: &Flown) -> String {
    match &flown.result {
        Ok(shown) => format!(
            "Calibrated by {} in {:.0} s of flight. Expected error {:.2} deg rms, actual {:.2}.",
            shown.method,
            flown.duration_s,
            shown.expected_rms_deg,
            flown.after.figures().rms_deg
        ),
        Err(Notice::Refused { code, words }) => format!("The module refused: {code}: {words}."),
        Err(Notice::Calibrated(words)) => format!("Calibrated, but cal show could not be read: {words}."),
    }
}

fn figures_table(html: &mut String, flown: &Flown) -> std::fmt::Result {
    writeln!(html, "<table><tr><th>degrees<th>largest<th>rms<th>constant<th>largest less constant</tr>")?;
    let mut row = |name: &str, f: Figures| {
        writeln!(
            html,
            "<tr><td>{name}<td>{:.2}<td>{:.2}<td>{:.2}<td>{:.2}</tr>",
            f.max_deg, f.rms_deg, f.mean_deg, f.max_demeaned_deg
        )
    };
    row("before", flown.before.figures())?;
    row("after", flown.after.figures())?;
    if let Some(streamed) = &flown.streamed {
        writeln!(
            html,
            "<tr><td>streamed in flight<td>{:.2}<td>{:.2}<td><td></tr>",
            streamed.max_deg, streamed.rms_deg
        )?;
    }
    writeln!(html, "</table>")
}

fn errors_table(html: &mut String, flown: &Flown) -> std::fmt::Result {
    writeln!(
        html,
        "<h2>By heading and bank</h2>\n<table><tr><th>heading<th>before: level<th>right 25<th>left 25<th>after: level\
         <th>right 25<th>left 25</tr>"
    )?;
    for step in 0..12 {
        write!(html, "<tr><td>{}", step * 30)?;
        for bank in flown.before.0.iter().chain(&flown.after.0) {
            write!(html, "<td>{:.2}", bank[step])?;
        }
        writeln!(html, "</tr>")?;
    }
    writeln!(html, "</table>")
}

fn coefficients(html: &mut String, shown: &Shown) -> std::fmt::Result {
    let calibration = &shown.calibration;
    writeln!(html, "<h2>Coefficients</h2>\n<table><tr><th>corrected field = W (m - b)<th>x<th>y<th>z</tr>")?;
    for (name, row) in ["W, x", "W, y", "W, z"].iter().zip(&calibration.w) {
        writeln!(html, "<tr><td>{name}<td>{:.5}<td>{:.5}<td>{:.5}</tr>", row[0], row[1], row[2])?;
    }
    let [x, y, z] = calibration.b_ut;
    writeln!(html, "<tr><td>b, uT<td>{x:.3}<td>{y:.3}<td>{z:.3}</tr></table>")?;
    writeln!(
        html,
        "<p>Field {:.2} uT, inclination {:.2} deg.</p>",
        calibration.total_ut,
        calibration.inclination_rad.to_degrees()
    )
}

/// Text as a page shows it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// A terminal's text without its control sequences.
fn plain(session: &str) -> String {
    session.replace("\r\u{1b}[2K", "").replace('\r', "")
}
