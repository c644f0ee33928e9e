//! Residuals over time, with what happened.

use super::super::frame::{Axis, Frame};
use super::super::model::{Moment, Swung, largest, most_of};
use super::super::svg::{At, Svg};
use super::super::text::number;
use super::{Key, Picture, legend};

/// Of columns drawn, each from its least to its largest value: an hour takes no more than a minute.
const COLUMNS: usize = 500;

/// A line is broken where nothing is known for so long, seconds, and for so many columns.
const GAP_S: f64 = 3.0;
const GAP_COLUMNS: f64 = 4.0;

const LEFT: f64 = 62.0;
const WIDTH: f64 = 640.0;
const PANEL: f64 = 104.0;

/// A panel: what it shows, and of what.
type Panel<'a> = (&'a str, fn(&Moment) -> Option<f64>);

/// The picture; none of nothing.
pub fn over_time(swung: &Swung, word: &str) -> Option<Picture> {
    let error = format!("{word}, deg");
    let panels: Vec<Panel<'_>> = [
        ("strength, %", (|moment| moment.strength_percent) as fn(&Moment) -> Option<f64>),
        ("dip, deg", |moment| moment.dip_deg),
        (&error, |moment| moment.error_deg),
    ]
    .into_iter()
    .filter(|(_, of)| swung.moments.iter().any(|moment| of(moment).is_some_and(f64::is_finite)))
    .collect();
    let x = Axis::seconds(swung.moments.last()?.at_s);
    if panels.is_empty() {
        return None;
    }
    let rows = swung.marks.len().min(3) as f64;
    let mut svg = Svg::new(LEFT + WIDTH + 20.0, 76.0 + 15.0 * rows + (PANEL + 14.0) * panels.len() as f64);
    let items = [
        (Key::Line("l trace"), "as it was"),
        (Key::Line("edge"), "expected, 1 sigma"),
        (Key::Area("bent"), "would not be sent"),
        (Key::Area("off"), "does not count"),
    ];
    let top = legend(&mut svg, [16.0, 8.0], WIDTH + 60.0, &items) + 15.0 * rows;
    let mut beyond = 0;
    for (i, (name, of)) in panels.iter().enumerate() {
        let values = || swung.moments.iter().filter(|moment| moment.is_usable).filter_map(of);
        let most = (1.5 * most_of(values(), 0.98)).min(largest(values())).max(most_of(values(), 0.5));
        beyond += values().filter(|value| value.abs() > 1.5 * most).count();
        let at = [LEFT, top + (PANEL + 14.0) * i as f64];
        let frame = Frame { x, y: Axis::deviations(most), at, size: [WIDTH, PANEL] };
        shade(&mut svg, &frame, &swung.moments);
        frame.draw(&mut svg, if i + 1 == panels.len() { "time, s" } else { "" }, name);
        svg.path("l trace", line(&frame, &swung.moments, of, false));
        if i + 1 == panels.len() && swung.moments.iter().any(|moment| moment.error_deg.is_some()) {
            for side in [1.0, -1.0] {
                let sigma = |moment: &Moment| Some(side * moment.sigma_deg.filter(|_| moment.error_deg.is_some())?);
                svg.path("edge", line(&frame, &swung.moments, &sigma, true));
            }
        }
        for mark in &swung.marks {
            let across = frame.across(mark.at_s.clamp(0.0, x.ends[1]));
            svg.line("moment", [across, at[1]], [across, frame.below()]);
        }
    }
    for (i, mark) in swung.marks.iter().take(3).enumerate() {
        let across = LEFT + WIDTH * (mark.at_s / x.ends[1]).clamp(0.0, 1.0);
        let class = if across > LEFT + WIDTH / 2.0 { "name end" } else { "name" };
        let y = top - 6.0 - 15.0 * (rows - 1.0 - i as f64);
        svg.text(class, [across, y], &mark.name);
        svg.line("moment", [across, y + 2.0], [across, top]);
    }
    Some(Picture { svg, title: "Over time".to_owned(), words: words(swung, beyond), is_wide: true })
}

fn words(swung: &Swung, beyond: usize) -> String {
    const WHAT: &str = "The corrected field against the Earth's, in strength and dip: steady iron and a right calibration \
                        leave noise about nothing, iron that moves or a current leaves steps and bumps.";
    let mut words = vec![WHAT.to_owned()];
    for mark in &swung.marks {
        words.push(format!("{} s: {}.", number(mark.at_s, 0), mark.name));
    }
    let silent = swung.moments.iter().filter(|moment| moment.is_silent).count();
    if silent > 0 {
        let percent = 100.0 * silent as f64 / swung.moments.len().max(1) as f64;
        words.push(format!(
            "For {} % of the time the module would not have sent a heading.",
            number(percent, if percent < 1.0 { 2 } else { 1 })
        ));
    }
    if beyond > 0 {
        words.push(format!("{beyond} values beyond a frame are drawn on its edge."));
    }
    words.join(" ")
}

/// Columns, as many as the moments fill.
fn columns(moments: &[Moment]) -> usize {
    (moments.len() / 2).clamp(1, COLUMNS)
}

/// In which column something is.
fn column(frame: &Frame, columns: usize, at_s: f64) -> usize {
    ((at_s / frame.x.ends[1] * columns as f64) as usize).min(columns - 1)
}

/// Least and largest of each column, or the mean, joined; broken at gaps.
fn line(frame: &Frame, moments: &[Moment], of: &dyn Fn(&Moment) -> Option<f64>, is_mean: bool) -> Vec<Option<At>> {
    let number = columns(moments);
    let mut each: Vec<Vec<[f64; 2]>> = vec![Vec::new(); number];
    for moment in moments {
        let Some(value) = of(moment).filter(|value| value.is_finite()) else { continue };
        if let Some(cell) = each.get_mut(column(frame, number, moment.at_s)) {
            cell.push([moment.at_s, value]);
        }
    }
    let gap_s = GAP_S.max(GAP_COLUMNS * frame.x.ends[1] / number as f64);
    let mut points = Vec::new();
    let mut last_s = None;
    for cell in each {
        let Some(&[at_s, first]) = cell.last() else { continue };
        if last_s.is_some_and(|last_s| at_s - last_s > gap_s) {
            points.push(None);
        }
        last_s = Some(at_s);
        let x = frame.across(at_s);
        let values = || cell.iter().map(|[_, value]| *value);
        let [least, most] = [values().fold(first, f64::min), values().fold(first, f64::max)];
        if is_mean {
            points.push(Some([x, frame.up(values().sum::<f64>() / cell.len() as f64)]));
        } else {
            points.push(Some([x, frame.up(least)]));
            points.extend((most > least).then(|| Some([x, frame.up(most)])));
        }
    }
    points
}

/// Where it does not count, and where no heading would have been sent.
fn shade(svg: &mut Svg, frame: &Frame, moments: &[Moment]) {
    let number = columns(moments);
    for (class, counts) in [("off", false), ("bent", true)] {
        let belongs = |moment: &Moment| moment.is_usable == counts && (moment.is_silent || !counts);
        let mut shaded = vec![false; number + 1];
        for moment in moments.iter().filter(|moment| belongs(moment)) {
            if let Some(cell) = shaded.get_mut(column(frame, number, moment.at_s)) {
                *cell = true;
            }
        }
        let mut from = None;
        for (i, is) in shaded.into_iter().enumerate() {
            match (is, from) {
                (true, None) => from = Some(i),
                (false, Some(first)) => {
                    let [left, right] =
                        [first, i].map(|column| frame.at[0] + frame.size[0] * column as f64 / number as f64);
                    svg.rect(class, [left, frame.at[1]], [right - left, frame.size[1]]);
                    from = None;
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::model::Mark;
    use super::*;

    fn flight(number: u32, every_s: f64) -> Swung {
        let moment = |i: u32| Moment {
            at_s: f64::from(i) * every_s,
            strength_percent: Some(f64::from(i % 7) - 3.0),
            is_usable: !(100..200).contains(&i),
            is_silent: (300..310).contains(&i),
            ..Moment::default()
        };
        let marks = vec![Mark { at_s: 5.0, name: "iron changed".to_owned() }];
        Swung { moments: (0..number).map(moment).collect(), marks, ..Swung::default() }
    }

    #[test]
    fn an_hour_is_drawn_as_little_as_a_minute_with_its_extremes() {
        let drawn = |swung: &Swung| over_time(swung, "error").unwrap().svg.inline("p", "", "");
        let mut hour = flight(180_000, 0.02);
        assert!(drawn(&hour).len() < 30_000, "{}", drawn(&hour).len());
        let before = drawn(&hour);
        // The scale is that of most: one value in 180,000 shows all the same, to either side.
        for (at, beyond) in [(90_000, -3.3), (120_000, 3.3)] {
            let drawn_before = drawn(&hour);
            hour.moments[at].strength_percent = Some(beyond);
            assert_ne!(drawn_before, drawn(&hour), "{beyond}");
        }
        assert_eq!(before.matches(r#"class="off""#).count(), 2, "one span, and its key");
        assert_eq!(before.matches(r#"class="bent""#).count(), 2, "one span, and its key");
        assert!(before.contains(">iron changed</text>") && !before.contains("NaN"));
    }

    #[test]
    fn a_gap_breaks_the_line_and_nothing_is_none() {
        let mut swung = flight(400, 0.1);
        let frame = Frame { x: Axis::seconds(139.9), y: Axis::deviations(3.0), at: [0.0; 2], size: [500.0, 100.0] };
        let gaps = |swung: &Swung| {
            line(&frame, &swung.moments, &|moment: &Moment| moment.strength_percent, false)
                .iter()
                .filter(|at| at.is_none())
                .count()
        };
        assert_eq!(gaps(&swung), 0);
        for moment in &mut swung.moments[200..] {
            moment.at_s += 100.0;
        }
        assert_eq!(gaps(&swung), 1);
        assert!(over_time(&Swung::default(), "error").is_none());
        let nothing = Swung { moments: vec![Moment::default(); 5], ..Swung::default() };
        assert!(over_time(&nothing, "error").is_none());
    }
}
