//! Coordinate axes of all pictures.

use super::svg::{PicturePoint, Svg};
use crate::numbers::format_number;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartAxis {
    /// Values at both ends of the axis.
    pub value_range: [f64; 2],
    /// Interval of the grid lines.
    pub grid_step: f64,
    /// Number of grid lines from one numbered line to the next.
    pub lines_per_number: usize,
}

impl ChartAxis {
    /// Heading axis: lines every 30 deg, numbers every 30 or 90 deg.
    pub const fn for_headings(number_interval_deg: usize) -> Self {
        Self { value_range: [0.0, 360.0], grid_step: 30.0, lines_per_number: number_interval_deg / 30 }
    }

    /// Symmetric axis of angles, degrees.
    pub fn symmetric_deg(max_deg: f64) -> Self {
        let limit_deg = if max_deg.is_finite() { max_deg.clamp(0.1, 180.0) } else { 1.0 };
        let step = match limit_deg {
            90.0.. => 90.0,
            45.0.. => 30.0,
            _ => round_step(limit_deg / 3.0),
        };
        let axis_end_deg = (limit_deg / step).ceil() * step;
        Self { value_range: [-axis_end_deg, axis_end_deg], grid_step: step, lines_per_number: 1 }
    }

    pub fn grid_values(&self) -> impl Iterator<Item = f64> + use<> {
        let (step, [from, to]) = (self.grid_step, self.value_range);
        let first = (from / step - 1e-6).ceil() as i64;
        let last = (to / step + 1e-6).floor() as i64;
        (first..=last).map(move |line| line as f64 * step)
    }

    fn decimals(&self) -> usize {
        if self.grid_step >= 1.0 { 0 } else { (-libm::log10(self.grid_step) - 1e-9).ceil() as usize }
    }

    fn axis_fraction(&self, value: f64) -> f64 {
        (value - self.value_range[0]) / (self.value_range[1] - self.value_range[0])
    }
}

/// Smallest 1, 2 or 5 times a power of ten not less than `min_step`.
fn round_step(min_step: f64) -> f64 {
    let power = libm::pow(10_f64, libm::log10(min_step).floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|times| times * power)
        .find(|step| *step >= min_step * 0.999)
        .unwrap_or(10.0 * power)
}

#[derive(Clone, Copy, Debug)]
pub struct PlotFrame {
    pub x: ChartAxis,
    pub y: ChartAxis,
    /// Upper left corner of the frame.
    pub upper_left: PicturePoint,
    pub size: PicturePoint,
}

impl PlotFrame {
    /// Position of a point; none if outside or NaN.
    pub fn plot_point(&self, x: f64, y: f64) -> Option<PicturePoint> {
        let inside = |axis: &ChartAxis, value: f64| (-1e-9..=1.0 + 1e-9).contains(&axis.axis_fraction(value));
        (inside(&self.x, x) && inside(&self.y, y)).then(|| [self.x_position(x), self.y_position(y)])
    }

    pub fn x_position(&self, x: f64) -> f64 {
        self.upper_left[0] + self.x.axis_fraction(x) * self.size[0]
    }

    /// Vertical position, clamped to the frame.
    pub fn y_position(&self, y: f64) -> f64 {
        self.upper_left[1] + (1.0 - self.y.axis_fraction(y).clamp(0.0, 1.0)) * self.size[1]
    }

    pub fn bottom(&self) -> f64 {
        self.upper_left[1] + self.size[1]
    }

    pub fn centre_x(&self) -> f64 {
        self.upper_left[0] + self.size[0] / 2.0
    }

    pub fn draw_axes(&self, svg: &mut Svg, x_name: &str, y_name: &str) {
        let [left, top] = self.upper_left;
        let (right_edge, bottom_edge) = (left + self.size[0], self.bottom());
        for (i, line) in self.x.grid_values().enumerate() {
            let x = self.x_position(line);
            svg.draw_line("grid", [x, top], [x, bottom_edge]);
            svg.draw_line("axis", [x, bottom_edge], [x, bottom_edge + 4.0]);
            if i.is_multiple_of(self.x.lines_per_number) && !x_name.is_empty() {
                svg.draw_text("tick mid", [x, bottom_edge + 17.0], &format_number(line, self.x.decimals()));
            }
        }
        for line in self.y.grid_values() {
            let y = self.y_position(line);
            svg.draw_line(
                if line.abs() < self.y.grid_step / 2.0 { "zero" } else { "grid" },
                [left, y],
                [right_edge, y],
            );
            svg.draw_text("tick end", [left - 6.0, y + 4.0], &format_number(line, self.y.decimals()));
        }
        svg.draw_rectangle("box", self.upper_left, self.size);
        svg.draw_text("name mid", [self.centre_x(), bottom_edge + 34.0], x_name);
        svg.draw_vertical_text("name mid", [left - 43.0, top + self.size[1] / 2.0], y_name);
    }
}

/// Points of a closed line of errors by heading, interrupted at missing values and at jumps across 180 deg.
pub fn closed_heading_curve(errors_deg: &[Option<f64>]) -> Vec<Option<PicturePoint>> {
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

    fn grid_lines(axis: ChartAxis) -> Vec<f64> {
        axis.grid_values().collect()
    }

    #[test]
    fn grid_lines_are_at_round_numbers() {
        assert_eq!(grid_lines(ChartAxis::for_headings(30)), (0..=12).map(|i| 30.0 * f64::from(i)).collect::<Vec<_>>());
        assert_eq!(grid_lines(ChartAxis::symmetric_deg(21.7)), [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]);
        assert_eq!(grid_lines(ChartAxis::symmetric_deg(0.8)), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(grid_lines(ChartAxis::symmetric_deg(50.0)), [-60.0, -30.0, 0.0, 30.0, 60.0]);
        assert_eq!(grid_lines(ChartAxis::symmetric_deg(170.0)), [-180.0, -90.0, 0.0, 90.0, 180.0]);
        let axis = ChartAxis::symmetric_deg(f64::NAN);
        assert!((2..20).contains(&grid_lines(axis).len()), "{axis:?}");
        assert!(axis.value_range[1] > axis.value_range[0], "{axis:?}");
    }

    #[test]
    fn every_grid_line_has_its_number() {
        let frame = PlotFrame {
            x: ChartAxis::for_headings(30),
            y: ChartAxis::symmetric_deg(0.8),
            upper_left: [50.0, 10.0],
            size: [300.0, 200.0],
        };
        let mut svg = Svg::new(400.0, 300.0);
        frame.draw_axes(&mut svg, "heading, deg", "error, deg");
        let whole = svg.to_inline("p", "", "");
        for tick in ["0", "30", "60", "330", "360", "-1.0", "-0.5", "0.0", "0.5", "1.0"] {
            assert!(whole.contains(&format!(">{tick}</text>")), "{tick}");
        }
        let at_ninety = PlotFrame { x: ChartAxis::for_headings(90), ..frame };
        let mut svg = Svg::new(400.0, 300.0);
        at_ninety.draw_axes(&mut svg, "heading, deg", "");
        let whole = svg.to_inline("p", "", "");
        assert!(whole.contains(">90</text>") && whole.contains(">360</text>") && !whole.contains(">30</text>"));
    }

    #[test]
    fn points_outside_the_frame_are_not_drawn() {
        let frame = PlotFrame {
            x: ChartAxis::for_headings(30),
            y: ChartAxis::symmetric_deg(1.0),
            upper_left: [50.0, 10.0],
            size: [360.0, 200.0],
        };
        assert_eq!(frame.plot_point(90.0, 0.0), Some([140.0, 110.0]));
        assert_eq!(frame.plot_point(0.0, 1.0), Some([50.0, 10.0]));
        for (x, y) in [(-1.0, 0.0), (361.0, 0.0), (0.0, 1.1), (0.0, -1.1), (f64::NAN, 0.0), (0.0, f64::NAN)] {
            assert_eq!(frame.plot_point(x, y), None, "{x} {y}");
        }
    }

    #[test]
    fn a_heading_curve_is_closed_and_broken_at_jumps() {
        let errors = [Some(1.0), Some(2.0), None, Some(170.0), Some(-170.0), Some(f64::NAN)];
        let points = closed_heading_curve(&errors);
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
        assert!(closed_heading_curve(&[]).is_empty());
    }
}
