//! Axes: the one frame of all pictures that have two.

use super::svg::{At, Svg};
use super::text::number;

/// One axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Its ends.
    pub ends: [f64; 2],
    /// From one line to the next.
    pub step: f64,
    /// Every so manyeth line has a number.
    pub numbered: usize,
}

impl Axis {
    /// Headings: lines at 30 deg, numbers at 30 or at 90.
    pub const fn headings(numbered_deg: usize) -> Self {
        Self { ends: [0.0, 360.0], step: 30.0, numbered: numbered_deg / 30 }
    }

    /// As much as there is and a little more, up to some lines, at steps that people count in.
    pub fn around(least: f64, most: f64, lines: f64) -> Self {
        let (least, most) = if least.is_finite() && most.is_finite() { (least, most) } else { (0.0, 1.0) };
        let span = (most - least).max(least.abs() * 1e-6).max(1e-3);
        let step = round_step(span / lines);
        Self { ends: [(least / step).floor() * step, (most / step).ceil() * step], step, numbered: 1 }.with_room()
    }

    /// Angles in degrees to both sides of nothing: beyond 45 deg lines stand at 30 or 90.
    pub fn deviations(most_deg: f64) -> Self {
        let most = if most_deg.is_finite() { most_deg.clamp(0.1, 180.0) } else { 1.0 };
        let step = match most {
            90.0.. => 90.0,
            45.0.. => 30.0,
            _ => round_step(most / 3.0),
        };
        let end = (most / step).ceil() * step;
        Self { ends: [-end, end], step, numbered: 1 }
    }

    /// Seconds of a flight, with lines at round seconds or minutes.
    pub fn seconds(most_s: f64) -> Self {
        const STEPS: [f64; 13] = [1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 3600.0, 7200.0];
        let most = if most_s.is_finite() { most_s.max(1.0) } else { 1.0 };
        let step = STEPS.into_iter().find(|step| most / step <= 10.0).unwrap_or_else(|| round_step(most / 10.0));
        Self { ends: [0.0, most], step, numbered: 1 }
    }

    fn with_room(self) -> Self {
        let [from, to] = self.ends;
        if to > from { self } else { Self { ends: [from, from + self.step], ..self } }
    }

    /// Where its lines stand.
    pub fn lines(&self) -> impl Iterator<Item = f64> + use<> {
        let (step, [from, to]) = (self.step, self.ends);
        let first = (from / step - 1e-6).ceil() as i64;
        let last = (to / step + 1e-6).floor() as i64;
        (first..=last).map(move |line| line as f64 * step)
    }

    fn decimals(&self) -> usize {
        if self.step >= 1.0 { 0 } else { (-self.step.log10() - 1e-9).ceil() as usize }
    }

    /// How far along it something is, 0 to 1.
    fn part(&self, value: f64) -> f64 {
        (value - self.ends[0]) / (self.ends[1] - self.ends[0])
    }
}

/// 1, 2 or 5 times a power of ten, not less than asked for.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|times| times * power).find(|step| *step >= least * 0.999).unwrap_or(10.0 * power)
}

/// Two axes and where in a picture they span a rectangle.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// The upper left corner.
    pub at: At,
    /// Width and height.
    pub size: At,
}

impl Frame {
    /// Where a point lies; none if it is outside, or no number.
    pub fn point(&self, x: f64, y: f64) -> Option<At> {
        let inside = |axis: &Axis, value: f64| (-1e-9..=1.0 + 1e-9).contains(&axis.part(value));
        (inside(&self.x, x) && inside(&self.y, y)).then(|| [self.across(x), self.up(y)])
    }

    /// Where a value of the x axis lies.
    pub fn across(&self, x: f64) -> f64 {
        self.at[0] + self.x.part(x) * self.size[0]
    }

    /// Where a value of the y axis lies; what is beyond the frame on its edge.
    pub fn up(&self, y: f64) -> f64 {
        self.at[1] + (1.0 - self.y.part(y).clamp(0.0, 1.0)) * self.size[1]
    }

    /// The place below it.
    pub fn below(&self) -> f64 {
        self.at[1] + self.size[1]
    }

    /// Its middle, from left to right.
    pub fn middle(&self) -> f64 {
        self.at[0] + self.size[0] / 2.0
    }

    /// Lines, numbers, and what the axes are.
    pub fn draw(&self, svg: &mut Svg, x_name: &str, y_name: &str) {
        let [left, top] = self.at;
        let (right, bottom) = (left + self.size[0], self.below());
        for (i, line) in self.x.lines().enumerate() {
            let x = self.across(line);
            svg.line("grid", [x, top], [x, bottom]);
            svg.line("axis", [x, bottom], [x, bottom + 4.0]);
            if i.is_multiple_of(self.x.numbered) && !x_name.is_empty() {
                svg.text("tick mid", [x, bottom + 17.0], &number(line, self.x.decimals()));
            }
        }
        for line in self.y.lines() {
            let y = self.up(line);
            svg.line(if line.abs() < self.y.step / 2.0 { "zero" } else { "grid" }, [left, y], [right, y]);
            svg.text("tick end", [left - 6.0, y + 4.0], &number(line, self.y.decimals()));
        }
        svg.rect("box", self.at, self.size);
        svg.text("name mid", [self.middle(), bottom + 34.0], x_name);
        svg.text_up("name mid", [left - 43.0, top + self.size[1] / 2.0], y_name);
    }
}

/// Errors by heading as a line: it ends where it began, and is broken where there is none and where it passes 180 deg.
pub fn round_the_circle(errors_deg: &[Option<f64>]) -> Vec<Option<At>> {
    let step_deg = 360.0 / errors_deg.len().max(1) as f64;
    let mut points = Vec::new();
    let mut last: Option<f64> = None;
    for (i, error) in errors_deg.iter().chain(errors_deg.first()).enumerate() {
        let error = error.filter(|error| error.is_finite());
        if last.zip(error).is_some_and(|(last, error)| (error - last).abs() > 180.0) {
            points.push(None);
        }
        points.push(error.map(|error| [i as f64 * step_deg, error]));
        last = error;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(axis: Axis) -> Vec<f64> {
        axis.lines().collect()
    }

    #[test]
    fn lines_stand_where_people_look_for_them() {
        assert_eq!(lines(Axis::headings(30)), (0..=12).map(|i| 30.0 * f64::from(i)).collect::<Vec<_>>());
        assert_eq!(lines(Axis::deviations(21.7)), [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]);
        assert_eq!(lines(Axis::deviations(0.8)), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(lines(Axis::deviations(50.0)), [-60.0, -30.0, 0.0, 30.0, 60.0]);
        assert_eq!(lines(Axis::deviations(170.0)), [-180.0, -90.0, 0.0, 90.0, 180.0]);
        assert_eq!(lines(Axis::seconds(826.0)).len(), 7);
        assert_eq!(lines(Axis::around(-3.0, 41.0, 5.0)), [-10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0]);
        // From nothing that is a number, or from a single one, still a frame.
        for axis in [
            Axis::around(f64::NAN, 1.0, 5.0),
            Axis::around(2.0, 2.0, 5.0),
            Axis::around(0.0, 0.0, 5.0),
            Axis::deviations(f64::NAN),
            Axis::seconds(f64::INFINITY),
        ] {
            assert!((2..20).contains(&lines(axis).len()), "{axis:?}");
            assert!(axis.ends[1] > axis.ends[0], "{axis:?}");
        }
    }

    #[test]
    fn every_line_has_its_number() {
        let frame = Frame { x: Axis::headings(30), y: Axis::deviations(0.8), at: [50.0, 10.0], size: [300.0, 200.0] };
        let mut svg = Svg::new(400.0, 300.0);
        frame.draw(&mut svg, "heading, deg", "error, deg");
        let whole = svg.inline("p", "", "");
        for tick in ["0", "30", "60", "330", "360", "-1.0", "-0.5", "0.0", "0.5", "1.0"] {
            assert!(whole.contains(&format!(">{tick}</text>")), "{tick}");
        }
        let at_ninety = Frame { x: Axis::headings(90), ..frame };
        let mut svg = Svg::new(400.0, 300.0);
        at_ninety.draw(&mut svg, "heading, deg", "");
        let whole = svg.inline("p", "", "");
        assert!(whole.contains(">90</text>") && whole.contains(">360</text>") && !whole.contains(">30</text>"));
    }

    #[test]
    fn points_lie_inside_or_nowhere() {
        let frame = Frame { x: Axis::headings(30), y: Axis::deviations(1.0), at: [50.0, 10.0], size: [360.0, 200.0] };
        assert_eq!(frame.point(90.0, 0.0), Some([140.0, 110.0]));
        assert_eq!(frame.point(0.0, 1.0), Some([50.0, 10.0]));
        for (x, y) in [(-1.0, 0.0), (361.0, 0.0), (0.0, 1.1), (0.0, -1.1), (f64::NAN, 0.0), (0.0, f64::NAN)] {
            assert_eq!(frame.point(x, y), None, "{x} {y}");
        }
    }

    #[test]
    fn a_line_round_the_circle_is_closed_and_broken_where_it_jumps() {
        let errors = [Some(1.0), Some(2.0), None, Some(170.0), Some(-170.0), Some(f64::NAN)];
        let points = round_the_circle(&errors);
        let expected = [
            Some([0.0, 1.0]),
            Some([60.0, 2.0]),
            None,
            Some([180.0, 170.0]),
            None,
            Some([240.0, -170.0]),
            None,
            Some([360.0, 1.0]),
        ];
        assert_eq!(points, expected);
        assert!(round_the_circle(&[]).is_empty());
    }
}
