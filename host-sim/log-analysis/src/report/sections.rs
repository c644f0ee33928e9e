//! Sections of the page.

use super::model::{CompassReport, DeviationCurve, ReferenceInfo, Report, VerdictLine};
use super::pictures::{Picture, coverage, deviation, field, map as map_of, methods as side_by_side, residuals};
use super::text::{concat_map, escape_html};
use crate::numbers::{format_number, format_optional};
use crate::replay::verdict::CompassState;

/// State of each compass and what to do.
pub fn verdict_section(report: &Report) -> String {
    concat_map(&report.verdicts, verdict_line)
}

/// Figures, reference, the module's result and doubts.
pub fn findings_section(report: &Report) -> String {
    let mut html: Vec<String> = Vec::new();
    if !report.figures.is_empty() {
        let rows = concat_map(&report.figures, |[label, value]| {
            format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
        });
        html.push(format!("<dl class=\"figures\">\n{rows}</dl>\n"));
    }
    if !report.reference.reference_name.is_empty() {
        html.push(format!(
            "<p>Headings are compared with {}: {}. A difference is called {} here.</p>\n",
            escape_html(&report.reference.reference_name),
            escape_html(&report.reference.limits),
            escape_html(report.reference.difference_name)
        ));
    }
    if let Some(module_verdict) = &report.module_verdict {
        html.push(format!(
            "<p>An Autoswing module on this flight: {}.</p>\n",
            escape_html(module_verdict.trim_end_matches('.'))
        ));
    }
    if !report.notes.is_empty() {
        let notes = concat_map(&report.notes, |note| format!("<li>{}</li>\n", escape_html(note)));
        html.push(format!("<ul>\n{notes}</ul>\n"));
    }
    html.concat()
}

fn verdict_line(line: &VerdictLine) -> String {
    let (class, sign) = match line.state {
        CompassState::Good => ("good", "✓"),
        CompassState::Doubtful => ("doubtful", "?"),
        CompassState::Bad => ("bad", "✗"),
    };
    format!(
        "<p class=\"verdict {class}\"><span aria-hidden=\"true\">{sign}</span> <b>{}.</b> {}.</p>\n",
        line.word,
        escape_html(&capitalised(line.text.trim_end_matches('.')))
    )
}

/// Comparison of calibrators and compasses, picture and table.
pub fn comparison_section(report: &Report) -> String {
    let names: Vec<&str> = report.calibrators.compasses.iter().map(String::as_str).collect();
    let rows = report.calibrators.rows.iter().map(|(name, cells)| {
        let cells = cells.iter().map(|cell| format_optional(*cell, 2)).collect();
        (name.clone(), cells)
    });
    let caption = format!(
        "{} of headings against {}, degrees RMS less mean",
        capitalised(report.reference.difference_name),
        report.reference.reference_name
    );
    let table = table(&caption, "corrected by", &names, rows);
    let picture = side_by_side::comparison_picture(&report.calibrators, &report.reference);
    format!("{}{table}", picture.map_or_else(String::new, |picture| figure("methods", &picture)))
}

pub fn compass_section(id: &str, compass_report: &CompassReport, compared: &ReferenceInfo) -> String {
    let facts = concat_map(&compass_report.facts, |[label, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
    });
    let mut html = vec![format!("<dl class=\"facts\">\n{facts}</dl>\n<div class=\"pair\">\n")];
    if !compass_report.before.is_empty() {
        html.push(figure(
            &format!("{id}-scale"),
            &deviation::common_scale_picture(compass_report, compared.difference_name),
        ));
    }
    if let Some(picture) = deviation::enlarged_picture(compass_report, compared.difference_name) {
        html.push(figure(&format!("{id}-after"), &picture));
    }
    html.push("</div>\n".to_owned());
    if compared.is_accurate {
        html.push(deviation_card(compass_report, compared));
    }
    html.push(figure(&format!("{id}-coverage"), &coverage::coverage_picture(compass_report)));
    let rest = [
        ("time", residuals::residuals_picture(compass_report, compared.difference_name)),
        ("field", field::field_picture(compass_report)),
    ];
    for (name, picture) in rest.into_iter().filter_map(|(name, picture)| Some((name, picture?))) {
        html.push(figure(&format!("{id}-{name}"), &picture));
    }
    if let Some([x, y, z, b]) = compass_report.coefficients {
        let row = |name: &str, values_of_row: [f64; 3], decimals| {
            (name.to_owned(), values_of_row.iter().map(|number_of| format_number(*number_of, decimals)).collect())
        };
        let rows = [row("W, x", x, 5), row("W, y", y, 5), row("W, z", z, 5), row("b, uT", b, 3)];
        html.push(table(
            "Coefficients: corrected field = W (m - b), body axes",
            "",
            &["x", "y", "z"],
            rows.into_iter(),
        ));
    }
    html.concat()
}

/// Deviation card, as used with ships' compasses.
fn deviation_card(compass_report: &CompassReport, compared: &ReferenceInfo) -> String {
    let Some(first) = compass_report.before.first().or(compass_report.after.first()) else { return String::new() };
    let sectors = first.errors_deg.len();
    let step = 360 / sectors.max(1);
    let has_sigma = compass_report.sigma_deg.len() == sectors;
    let column = |when: &str, line: &DeviationCurve| format!("{when}: {}", line.name);
    let mut columns: Vec<String> = compass_report.before.iter().map(|line| column("before", line)).collect();
    columns.extend(compass_report.after.iter().map(|line| column("after", line)));
    if has_sigma {
        columns.push("sigma".to_owned());
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let row = |i: usize| {
        let lines = compass_report.before.iter().chain(&compass_report.after);
        let mut cells: Vec<String> =
            lines.map(|line| format_optional(line.errors_deg.get(i).copied().flatten(), 2)).collect();
        if has_sigma {
            let sigma = format_optional(compass_report.sigma_deg.get(i).copied(), 2);
            cells.push(if sigma == "–" { sigma } else { format!("± {sigma}") });
        }
        (format!("{:03}", i * step), cells)
    };
    // Both halves are placed side by side if there is room.
    let halves = [0..sectors.min(12), 12..sectors].into_iter().filter(|half| !half.is_empty()).map(|half| {
        let caption = format!("Headings {:03} to {:03}", half.start * step, (half.end - 1) * step);
        table(&caption, "heading", &columns, half.map(row))
    });
    format!(
        "<div class=\"card\">\n<h3>Deviation card: {}</h3>\n<p>{} by heading, degrees: indicated less {}. Take it off what the \
         compass shows.</p>\n<div class=\"halves\">{}</div></div>\n",
        escape_html(&compass_report.name),
        capitalised(compared.difference_name),
        escape_html(&compared.reference_name),
        concat_map(halves, |half| half)
    )
}

pub fn map_section(compass_report: &CompassReport) -> Option<String> {
    map_of::map_picture(compass_report).map(|picture| figure("map-picture", &picture))
}

pub fn parameters_section(name: &str, text: &str) -> String {
    let name = escape_html(name);
    format!(
        "<p><button type=\"button\" data-copy=\"parameters-text\" hidden>Copy</button> \
         <a class=\"button\" download=\"{name}\" href=\"data:text/plain;charset=utf-8,{}\">Download {name}</a> \
         <span role=\"status\" id=\"copied\"></span></p>\n<p>Load it with a ground station, and compare the heading on \
         the ground before you fly by it.</p>\n{}",
        percent_encoded(text),
        listing("parameters-text", "Parameters", text)
    )
}

/// Command, version, log, settings and terminal output.
pub fn origin_section(report: &Report) -> String {
    let rows = concat_map(&report.origin, |[label, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
    });
    let mut html = vec![format!("<dl class=\"facts\">\n{rows}</dl>\n")];
    if let Some([title, text]) = &report.terminal_output {
        html.push(format!(
            "<details><summary>{}</summary>\n{}</details>\n",
            escape_html(title),
            listing("printed-text", title, text)
        ));
    }
    html.concat()
}

fn figure(id: &str, picture: &Picture) -> String {
    let class = if picture.is_wide { "wide" } else { "narrow" };
    format!(
        "<figure class=\"{class}\"><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{title}: picture\">\n{}\
         </div><figcaption><b>{title}.</b> {}</figcaption></figure>\n",
        picture.svg.to_inline(id, &picture.title, &picture.description),
        escape_html(&picture.description),
        title = escape_html(&picture.title),
    )
}

/// A table in a scrolling box.
fn table(caption: &str, corner: &str, columns: &[&str], rows: impl Iterator<Item = (String, Vec<String>)>) -> String {
    let caption = escape_html(caption);
    let corner = if corner.is_empty() {
        "<td></td>".to_owned()
    } else {
        format!("<th scope=\"col\">{}</th>", escape_html(corner))
    };
    let head = concat_map(columns, |name| format!("<th scope=\"col\">{}</th>", escape_html(name)));
    let body = concat_map(rows, |(name, cells)| {
        let cells = concat_map(&cells, |cell| format!("<td>{}</td>", escape_html(cell)));
        format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escape_html(&name))
    });
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{caption}\"><table><caption>{caption}</caption>\n\
         <thead><tr>{corner}{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n"
    )
}

/// Text as part of a URI (RFC 3986).
fn percent_encoded(text: &str) -> String {
    concat_map(text.bytes(), |byte| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    })
}

fn listing(id: &str, name: &str, text: &str) -> String {
    let (name, text) = (escape_html(name), escape_html(text));
    format!(
        "<pre id=\"{id}\" class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{name}: text\">{text}</pre>\n"
    )
}

fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}
