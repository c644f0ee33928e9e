//! Comparison of calibrators.

use super::super::model::{CalibratorComparison, ReferenceInfo};
use super::super::svg::{Shape, Svg};
use super::{LegendSample, Picture, draw_legend};
use crate::numbers::format_number;

const CLASSES: [&str; 3] = ["p1", "p2", "p3"];

/// Draws the heading errors of each calibrator and compass on a logarithmic scale; none without data.
pub fn comparison_picture(methods: &CalibratorComparison, compared: &ReferenceInfo) -> Option<Picture> {
    const LEFT: f64 = 120.0;
    const WIDTH: f64 = 420.0;
    const ROW: f64 = 30.0;
    let all: Vec<f64> = methods
        .rows
        .iter()
        .flat_map(|(_, cells)| cells.iter().copied().flatten())
        .filter(|deg| deg.is_finite() && *deg > 0.0)
        .collect();
    let least = all.iter().copied().reduce(f64::min)?;
    let most = all.iter().copied().fold(least, f64::max);
    let lines: Vec<f64> =
        [0.01, 0.1, 1.0, 10.0, 100.0].into_iter().flat_map(|ten: f64| [ten, 2.0 * ten, 5.0 * ten]).collect();
    let from = lines.iter().copied().rfind(|line| *line <= least * 0.95).unwrap_or(0.01);
    let to = lines.iter().copied().find(|line| *line >= most * 1.05).unwrap_or(200.0);
    let names: Vec<&str> = methods.compasses.iter().map(String::as_str).collect();
    let items: Vec<(LegendSample, &str)> = names
        .iter()
        .enumerate()
        .map(|(i, name)| (LegendSample::Points(Shape::for_series(i), CLASSES[i % CLASSES.len()]), *name))
        .collect();
    let mut svg = Svg::new(LEFT + WIDTH + 30.0, 92.0 + ROW * methods.rows.len() as f64);
    let top = draw_legend(&mut svg, [16.0, 8.0], LEFT + WIDTH, &items);
    let bottom = top + ROW * methods.rows.len() as f64;
    let across = |deg: f64| LEFT + WIDTH * libm::log(deg / from) / libm::log(to / from);
    for line in lines.iter().copied().filter(|line| (from..=to).contains(line)) {
        svg.line("grid", [across(line), top], [across(line), bottom]);
        svg.line("axis", [across(line), bottom], [across(line), bottom + 4.0]);
        let decimals = if line < 0.1 { 2 } else { usize::from(line < 1.0) };
        svg.text("tick mid", [across(line), bottom + 17.0], &format_number(line, decimals));
    }
    for (i, (name, cells)) in methods.rows.iter().enumerate() {
        let y = top + ROW * (i as f64 + 0.5);
        svg.line("grid", [LEFT, y], [LEFT + WIDTH, y]);
        svg.text("name end", [LEFT - 8.0, y + 4.0], name);
        for (compass, deg) in cells.iter().enumerate().filter_map(|(compass, cell)| Some((compass, (*cell)?))) {
            // Shifted so that equal values do not overlap.
            let offset_y = 7.0 * (compass as f64 - (cells.len() - 1) as f64 / 2.0);
            let class = CLASSES[compass % CLASSES.len()];
            svg.points(class, Shape::for_series(compass), 4.0, [[across(deg), y + offset_y.clamp(-11.0, 11.0)]]);
        }
    }
    svg.rect("box", [LEFT, top], [WIDTH, bottom - top]);
    svg.text(
        "name mid",
        [LEFT + WIDTH / 2.0, bottom + 34.0],
        &format!("{}, deg RMS less mean", compared.difference_name),
    );
    let words = format!(
        "Between {} and {} deg against {}; further left is better. The numbers are in the table.",
        format_number(least, 2),
        format_number(most, 2),
        compared.reference_name
    );
    Some(Picture { svg, title: "Compasses side by side".to_owned(), description: words, is_wide: true })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_comparison_axis_covers_all_values_and_none_gives_no_picture() {
        let compared = ReferenceInfo { difference_name: "error", ..ReferenceInfo::default() };
        let rows = |cells: Vec<Option<f64>>| CalibratorComparison {
            compasses: vec!["compass 1".to_owned(), "compass 2".to_owned()],
            rows: vec![("ours".to_owned(), cells)],
        };
        assert!(comparison_picture(&rows(vec![None, Some(f64::NAN)]), &compared).is_none());
        let picture = comparison_picture(&rows(vec![Some(0.64), Some(27.0)]), &compared).unwrap();
        let svg_text = picture.svg.to_inline("p", "", "");
        assert!(
            svg_text.contains(">0.5</text>") && svg_text.contains(">50</text>") && !svg_text.contains(">100</text>")
        );
        assert!(picture.description.contains("0.64 and 27.00"));
    }
}
