//! Sections of the page.

use super::chart_samples::{has_samples, samples_json};
use super::model::{CompassReport, DeviationCurve, ReferenceInfo, Report, ReportSample, VerdictLine};
use super::pictures::{Picture, coverage, map as map_of};
use super::text::{concat_map, escape_html};
use crate::numbers::{format_number, format_optional};
use crate::replay::verdict::CompassState;

/// State of each compass and what to do.
pub fn verdict_section(report: &Report) -> String {
    concat_map(&report.verdicts, verdict_line)
}

/// Key figures, reference and warnings about the log.
pub fn findings_section(report: &Report) -> String {
    let mut html: Vec<String> = Vec::new();
    if !report.key_figures.is_empty() {
        let rows = concat_map(&report.key_figures, |[label, value]| {
            format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
        });
        html.push(format!("<dl class=\"figures\">\n{rows}</dl>\n"));
    }
    if !report.reference.reference_name.is_empty() {
        html.push(format!(
            "<p>Headings are compared with {}: {}. A difference is called {} here.</p>\n",
            escape_html(&report.reference.reference_name),
            escape_html(&report.reference.accuracy_text),
            escape_html(report.reference.difference_name)
        ));
    }
    if !report.log_warnings.is_empty() {
        let warning_items = concat_map(&report.log_warnings, |warning| format!("<li>{}</li>\n", escape_html(warning)));
        html.push(format!("<ul>\n{warning_items}</ul>\n"));
    }
    html.concat()
}

fn verdict_line(line: &VerdictLine) -> String {
    let (class, sign) = match line.compass_state {
        CompassState::Good => ("good", "✓"),
        CompassState::Fair => ("fair", "≈"),
        CompassState::Bad => ("bad", "✗"),
        CompassState::Unjudged => ("unjudged", "?"),
    };
    format!(
        "<p class=\"verdict {class}\"><span aria-hidden=\"true\">{sign}</span> <b>{}.</b> {}.</p>\n",
        line.state_word,
        escape_html(&capitalised(line.verdict_text.trim_end_matches('.')))
    )
}

/// Comparison of calibrators and compasses.
pub fn comparison_section(report: &Report) -> String {
    let names: Vec<&str> = report.calibrators.compasses.iter().map(String::as_str).collect();
    let rows = report.calibrators.calibrator_rows.iter().map(|(name, cells)| {
        let cells = cells.iter().map(|cell| format_optional(*cell, 2)).collect();
        (name.clone(), cells)
    });
    let caption = format!(
        "{} of headings against {}, degrees RMS about the mean",
        capitalised(report.reference.difference_name),
        report.reference.reference_name
    );
    format!("<p>{CORRECTIONS_TEXT}</p>\n{}", html_table(&caption, "corrected by", &names, rows))
}

const CORRECTIONS_TEXT: &str = "Uncorrected: the sensor's field. As logged: with the autopilot's parameters. Sphere: a fit of \
                           offsets alone. Ellipsoid: of offsets and a symmetric matrix, from the field alone. Module: an Autoswing module on this flight. Parameters to load: as the autopilot would apply them, on held-back rows, which are not part of the fit. \
                           Errors are of the whole flight, those of the parameters to load of the part that they are fitted to.";

/// A chart of `assets/charts.js`: its kind, title and description.
type Chart = (&'static str, &'static str, String);

fn charts(compass_report: &CompassReport, difference_name: &str) -> Vec<Chart> {
    let has_sample = |of: fn(&ReportSample) -> bool| compass_report.samples.iter().any(of);
    let corrected_by = compass_report.corrected_by;
    let marks = concat_map(&compass_report.event_marks, |mark| {
        format!(" {} s: {}.", format_number(mark.time_s, 0), mark.event_name)
    });
    let unused = if has_sample(|sample| !sample.is_usable) { " Grey: not used, as on the ground." } else { "" };
    let chart = |is_drawn: bool, kind, title, description| is_drawn.then_some((kind, title, description));
    [
        chart(
            has_sample(|sample| sample.raw_ut.is_some()),
            "strength",
            "Field strength and current",
            format!(
                "Corrected {corrected_by}, the strength should be that of the Earth's field at all times: a step is iron that changed, a \
                 bump motor current or iron nearby.{marks}{unused}"
            ),
        ),
        chart(
            has_sample(|sample| sample.error_deg.is_some() || sample.error_before_deg.is_some()),
            "errors",
            "Error over time",
            format!("{}, mean subtracted, with one sigma of the module.{}", capitalised(difference_name), withheld_headings_note(compass_report)),
        ),
        chart(
            !compass_report.curves_before.is_empty(),
            "by_heading",
            "Error by heading",
            format!("{} of each heading, and means. Choose a name in the legend to hide it.", capitalised(difference_name)),
        ),
        chart(
            has_sample(|sample| sample.corrected_ut.is_some()),
            "axes",
            "Three axes, expected and measured",
            format!(
                "The field corrected {corrected_by}, and the Earth's field turned into the axes of the aircraft by its attitude and \
                 heading (dashed)."
            ),
        ),
        chart(
            has_sample(|sample| sample.current_a.is_some_and(|a| a > 0.0) && sample.corrected_ut.is_some()),
            "current",
            "Field against current",
            format!(
                "Measured less expected field by axis, as logged and corrected {corrected_by}: a slope is interference by the motors."
            ),
        ),
        chart(
            has_sample(|sample| sample.raw_ut.is_some()),
            "sphere",
            "Directions of the field",
            format!(
                "Samples before the correction and corrected {corrected_by}, in the axes of the aircraft. Shaded: directions without a \
                 sample. Turn it by dragging or with the arrow keys."
            ),
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn withheld_headings_note(compass_report: &CompassReport) -> String {
    let withheld_count = compass_report.samples.iter().filter(|sample| sample.is_heading_withheld).count();
    if withheld_count == 0 {
        return String::new();
    }
    let percent = 100.0 * withheld_count as f64 / compass_report.samples.len().max(1) as f64;
    let percent = format_number(percent, if percent < 1.0 { 2 } else { 1 });
    format!(" Shaded: {percent} % of the time, without a heading of the module.")
}

pub fn compass_section(id: &str, compass_report: &CompassReport, compared: &ReferenceInfo) -> String {
    let facts = concat_map(&compass_report.facts, |[label, value]| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape_html(label), escape_html(value))
    });
    let mut html = vec![format!("<dl class=\"facts\">\n{facts}</dl>\n")];
    if has_samples(compass_report) {
        let charts = concat_map(
            charts(compass_report, compared.difference_name),
            |(chart_kind, title, description)| {
                let description = escape_html(&description);
                format!(
                    "<figure><div class=\"chart\" data-chart=\"{chart_kind}\" role=\"img\" aria-label=\"{title}: {description}\"></div>\
                 <figcaption><b>{title}.</b> {description}</figcaption></figure>\n"
                )
            },
        );
        // JSON in an HTML script must not contain "<", which could end the script.
        let json = samples_json(compass_report, compared.difference_name).to_string().replace('<', "\\u003c");
        html.push(format!(
            "<div class=\"charts\">\n<script type=\"application/json\">{json}</script>\n{charts}</div>\n\
             <noscript><p>The pictures need JavaScript.</p></noscript>\n"
        ));
    }
    if compared.is_accurate {
        html.push(deviation_card(compass_report, compared));
    }
    html.push("<div class=\"pair\">\n".to_owned());
    html.push(html_figure(&format!("{id}-coverage"), &coverage::coverage_picture(compass_report)));
    if let Some([x, y, z, b]) = compass_report.coefficients {
        let row = |name: &str, values_of_row: [f64; 3], decimals| {
            (name.to_owned(), values_of_row.iter().map(|number_of| format_number(*number_of, decimals)).collect())
        };
        let rows = [row("W, x", x, 5), row("W, y", y, 5), row("W, z", z, 5), row("b, uT", b, 3)];
        html.push(html_table(
            "Coefficients: corrected field = W (m - b), body axes",
            "",
            &["x", "y", "z"],
            rows.into_iter(),
        ));
    }
    html.push("</div>\n".to_owned());
    html.concat()
}

/// Deviation card, as used with ships' compasses.
fn deviation_card(compass_report: &CompassReport, compared: &ReferenceInfo) -> String {
    let Some(first) = compass_report.curves_before.first().or(compass_report.curves_after.first()) else {
        return String::new();
    };
    let sectors = first.errors_deg.len();
    let step = 360 / sectors.max(1);
    let has_sigma = compass_report.sigma_by_heading_deg.len() == sectors;
    let column = |column_title: &str, line: &DeviationCurve| format!("{column_title}: {}", line.curve_name);
    let mut columns: Vec<String> = compass_report.curves_before.iter().map(|line| column("before", line)).collect();
    columns.extend(compass_report.curves_after.iter().map(|line| column("after", line)));
    if has_sigma {
        columns.push("sigma".to_owned());
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let row = |i: usize| {
        let lines = compass_report.curves_before.iter().chain(&compass_report.curves_after);
        let mut cells: Vec<String> = lines.map(|line| format_optional(line.card_error_deg(i), 2)).collect();
        if has_sigma {
            let sigma = format_optional(compass_report.sigma_by_heading_deg.get(i).copied(), 2);
            cells.push(if sigma == "–" { sigma } else { format!("± {sigma}") });
        }
        (format!("{:03}", i * step), cells)
    };
    // Two tables, of the first 12 headings and of the others, side by side if there is room.
    let card_halves = [0..sectors.min(12), 12..sectors]
        .into_iter()
        .filter(|sector_range| !sector_range.is_empty())
        .map(|sector_range| {
            let caption = format!("Headings {:03} to {:03}", sector_range.start * step, (sector_range.end - 1) * step);
            html_table(&caption, "heading", &columns, sector_range.map(row))
        });
    let since = compass_report.last_change_s.map_or_else(String::new, |at_s| {
        format!(" Of the flight after {} s, the last change.", format_number(at_s, 0))
    });
    format!(
        "<div class=\"card\">\n<h3>Deviation card: {}</h3>\n<p>Degrees by heading: indicated less {}. Subtract it from the \
         indicated heading: with +3.00 at 090, a compass that shows 093 points to 090. {}{since}</p>\n<div class=\"halves\">{}</div>\
         </div>\n",
        escape_html(&compass_report.compass_name),
        escape_html(&compared.reference_name),
        escape_html(&compared.card_constant_text),
        concat_map(card_halves, |sector_range| sector_range)
    )
}

pub fn map_section(compass_report: &CompassReport) -> Option<String> {
    map_of::map_picture(compass_report).map(|picture| html_figure("map-picture", &picture))
}

pub fn parameters_section(name: &str, text: &str) -> String {
    let name = escape_html(name);
    format!(
        "<p><button type=\"button\" data-copy=\"parameters-text\" hidden>Copy</button> \
         <a class=\"button\" download=\"{name}\" href=\"data:text/plain;charset=utf-8,{}\">Download {name}</a> \
         <span role=\"status\" id=\"copied\"></span></p>\n<p>Load it with a ground station, and compare the heading on \
         the ground before you fly by it.</p>\n{}",
        percent_encoded(text),
        html_listing("parameters-text", "Parameters", text)
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
            "<details class=\"terminal\"><summary>{}</summary>\n{}</details>\n",
            escape_html(title),
            html_listing("printed-text", title, text)
        ));
    }
    html.concat()
}

fn html_figure(id: &str, picture: &Picture) -> String {
    let class = if picture.needs_full_width { "wide" } else { "narrow" };
    format!(
        "<figure class=\"{class}\"><div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{title}: picture\">\n{}\
         </div><figcaption><b>{title}.</b> {}</figcaption></figure>\n",
        picture.svg.to_inline(id, &picture.title, &picture.description),
        escape_html(&picture.description),
        title = escape_html(&picture.title),
    )
}

/// A table in a scrolling box.
fn html_table(
    caption: &str,
    corner: &str,
    columns: &[&str],
    rows: impl Iterator<Item = (String, Vec<String>)>,
) -> String {
    let caption = escape_html(caption);
    let corner = if corner.is_empty() {
        "<td></td>".to_owned()
    } else {
        format!("<th scope=\"col\">{}</th>", escape_html(corner))
    };
    let header_cells = concat_map(columns, |name| format!("<th scope=\"col\">{}</th>", escape_html(name)));
    let body_rows = concat_map(rows, |(name, cells)| {
        let cells = concat_map(&cells, |cell| format!("<td>{}</td>", escape_html(cell)));
        format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escape_html(&name))
    });
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{caption}\"><table><caption>{caption}</caption>\n\
         <thead><tr>{corner}{header_cells}</tr></thead>\n<tbody>\n{body_rows}</tbody></table></div>\n"
    )
}

/// Text as part of a URI (RFC 3986).
fn percent_encoded(text: &str) -> String {
    concat_map(text.bytes(), |byte| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    })
}

fn html_listing(id: &str, name: &str, text: &str) -> String {
    let (name, text) = (escape_html(name), escape_html(text));
    format!(
        "<pre id=\"{id}\" class=\"scroll\" tabindex=\"0\" role=\"group\" aria-label=\"{name}: text\">{text}</pre>\n"
    )
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}
