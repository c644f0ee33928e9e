//! What a page shows, wherever it comes from: a simulated mission or a log.

use autoswing::calibration::Calibration;
use autoswing::frames::{Field, Level};

use crate::score::wrap_180;

/// A page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Its title.
    pub title: String,
    /// Whether the module calibrated, or would have.
    pub accepted: bool,
    /// The verdict, one line.
    pub verdict: String,
    /// Figures that matter most: what, and how much.
    pub figures: Vec<[String; 2]>,
    /// What is doubtful.
    pub notes: Vec<String>,
    /// What headings are compared with, if with anything.
    pub compared: Compared,
    /// Calibrators side by side.
    pub methods: Methods,
    /// The compasses; the first that was accepted, else the first, is shown on the map.
    pub compasses: Vec<Swung>,
    /// Parameters to load: name and text of the file.
    pub parameters: Option<[String; 2]>,
    /// What a terminal showed: a title and the text.
    pub printed: Option<[String; 2]>,
    /// Command, version, log, settings.
    pub made: Vec<[String; 2]>,
}

impl Report {
    /// The first compass whose calibration was accepted, else the first.
    #[must_use]
    pub fn foremost(&self) -> Option<&Swung> {
        self.compasses.iter().find(|compass| compass.accepted).or_else(|| self.compasses.first())
    }
}

/// What headings are compared with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Compared {
    /// What a difference is called.
    pub word: &'static str,
    /// From what.
    pub with: String,
    /// What that is worth.
    pub limits: String,
}

/// How good the headings of several calibrators are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Methods {
    /// The compasses.
    pub compasses: Vec<String>,
    /// Each calibrator and what it reaches with each compass, degrees RMS less mean.
    pub rows: Vec<(String, Vec<Option<f64>>)>,
}

/// A compass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Swung {
    /// What it is called.
    pub name: String,
    /// Whether its calibration was accepted.
    pub accepted: bool,
    /// What there is to say: what, and how much.
    pub facts: Vec<[String; 2]>,
    /// Before the calibration, by heading.
    pub before: Vec<Line>,
    /// After it.
    pub after: Vec<Line>,
    /// Standard deviation that the module expects at each heading, degrees; as many as a line has, or none.
    pub sigma_deg: Vec<f64>,
    /// What that is.
    pub sigma_of: &'static str,
    /// The flight.
    pub moments: Vec<Moment>,
    /// Things that happened.
    pub marks: Vec<Mark>,
    /// Strength of the horizontal field, microtesla, if there is a calibration.
    pub horizontal_ut: Option<f64>,
    /// Whether it is known which moments were fitted to.
    pub knows_fitted: bool,
    /// What to fly next.
    pub advice: Option<String>,
    /// The coefficients: `W` row by row, and `b`, microtesla.
    pub coefficients: Option<[[f64; 3]; 4]>,
}

/// Errors by heading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// From north on clockwise at equal steps, degrees.
    pub errors_deg: Vec<Option<f64>>,
}

/// Something that happened.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mark {
    /// When, seconds from the first moment.
    pub at_s: f64,
    /// What.
    pub name: String,
}

/// A moment of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Seconds from the first.
    pub at_s: f64,
    /// Heading, degrees: the reference, or the module's own where there is none.
    pub heading_deg: Option<f64>,
    /// Bank, right wing down positive, degrees.
    pub roll_deg: f64,
    /// Pitch, nose up positive, degrees.
    pub pitch_deg: f64,
    /// Position, metres east and north.
    pub place_m: Option<[f64; 2]>,
    /// Horizontal field, level axes ahead and to the left, microtesla, before and after the correction.
    pub level_ut: [Option<[f64; 2]>; 2],
    /// Strength of the corrected field over that of the calibration, less one, percent.
    pub strength_percent: Option<f64>,
    /// Dip of the corrected field less that of the calibration, degrees.
    pub dip_deg: Option<f64>,
    /// Error of the heading after the correction, and its standard deviation, degrees.
    pub error_deg: Option<f64>,
    /// See there.
    pub sigma_deg: Option<f64>,
    /// Error before it, degrees.
    pub before_deg: Option<f64>,
    /// Whether it counts.
    pub is_usable: bool,
    /// Whether it was collected and fitted to.
    pub is_fitted: bool,
    /// Whether the module would not have sent the heading.
    pub is_silent: bool,
}

impl Moment {
    /// Takes in the levelled field before a correction, and after it with the calibration that made it.
    pub fn see(&mut self, before: Field<Level>, after: Option<(Field<Level>, &Calibration)>) {
        let level = |field: &Field<Level>| Some([f64::from(field.ut.x), f64::from(-field.ut.y)]);
        self.level_ut = [level(&before), after.as_ref().and_then(|(after, _)| level(after))];
        if let Some((after, calibration)) = after {
            self.strength_percent = Some(f64::from(after.ut.norm() / calibration.total_ut - 1.0) * 100.0);
            self.dip_deg = Some(f64::from((after.inclination_rad() - calibration.inclination_rad).to_degrees()));
        }
    }
}

/// From one heading of a line to the next, degrees, where they are means of a flight.
pub const STEP_DEG: f64 = 15.0;

/// Fewer than so many in a sector are no mean.
const FEW: usize = 3;

/// Means by heading over usable moments; the sum of errors close to each other, as those of one sector are.
pub fn by_heading(moments: &[Moment], of: impl Fn(&Moment) -> Option<f64>) -> Vec<Option<f64>> {
    let mut sums = [(0.0, 0.0, 0_usize); 24];
    for moment in moments.iter().filter(|moment| moment.is_usable) {
        let (Some(heading_deg), Some(value)) = (moment.heading_deg, of(moment).filter(|value| value.is_finite()))
        else {
            continue;
        };
        let sector = (heading_deg / STEP_DEG).round().rem_euclid(24.0) as usize;
        if let Some((sin, cos, number)) = sums.get_mut(sector) {
            let (s, c) = value.to_radians().sin_cos();
            (*sin, *cos, *number) = (*sin + s, *cos + c, *number + 1);
        }
    }
    sums.iter().map(|(sin, cos, number)| (*number >= FEW).then(|| sin.atan2(*cos).to_degrees())).collect()
}

/// The mean of angles on the circle, degrees.
pub fn mean_deg(angles: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sin, mut cos, mut number) = (0.0, 0.0, 0_usize);
    for (s, c) in angles.filter(|angle| angle.is_finite()).map(|angle| angle.to_radians().sin_cos()) {
        (sin, cos, number) = (sin + s, cos + c, number + 1);
    }
    (number > 0).then(|| sin.atan2(cos).to_degrees())
}

impl Swung {
    /// Takes the constant out of the errors of usable moments, before and after apart; what it was.
    pub fn take_out_the_mean(&mut self) -> [Option<f64>; 2] {
        let usable = |of: fn(&Moment) -> Option<f64>| {
            mean_deg(self.moments.iter().filter(|moment| moment.is_usable).filter_map(of))
        };
        let means = [usable(|moment| moment.before_deg), usable(|moment| moment.error_deg)];
        for moment in &mut self.moments {
            let less = |error: Option<f64>, mean: Option<f64>| Some(wrap_180(error? - mean?));
            moment.before_deg = less(moment.before_deg, means[0]);
            moment.error_deg = less(moment.error_deg, means[1]);
        }
        means
    }
}

/// The largest of some, without their signs; nothing of none.
pub fn largest(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.filter(|number| number.is_finite()).map(f64::abs).fold(0.0, f64::max)
}

/// The value that so much of some do not exceed, 0 to 1, without their signs; nothing of none.
pub fn most_of(numbers: impl Iterator<Item = f64>, part: f64) -> f64 {
    let mut sizes: Vec<f64> = numbers.filter(|number| number.is_finite()).map(f64::abs).collect();
    sizes.sort_by(f64::total_cmp);
    let last = sizes.len().saturating_sub(1);
    sizes.get((part * last as f64).round() as usize).copied().unwrap_or(0.0)
}

/// At most so many of some, evenly spread.
pub fn thinned<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    all.iter().step_by(all.len().div_ceil(most.max(1)).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(heading_deg: f64, error_deg: f64) -> Moment {
        Moment { heading_deg: Some(heading_deg), error_deg: Some(error_deg), is_usable: true, ..Moment::default() }
    }

    #[test]
    fn sectors_have_their_heading_in_the_middle() {
        let mut moments: Vec<Moment> = [353.0, 0.0, 7.0].map(|heading_deg| at(heading_deg, 2.0)).to_vec();
        moments.extend([8.0, 15.0, 22.0].map(|heading_deg| at(heading_deg, 5.0)));
        // Two are no mean; one that does not count, and one that is no number, are none.
        moments.extend([90.0, 90.0].map(|heading_deg| at(heading_deg, 9.0)));
        moments.push(Moment { is_usable: false, ..at(90.0, 9.0) });
        moments.push(at(90.0, f64::NAN));
        let means = by_heading(&moments, |moment| moment.error_deg);
        let found: Vec<(usize, f64)> = means.iter().enumerate().filter_map(|(i, mean)| Some((i, (*mean)?))).collect();
        assert!(matches!(found[..], [(0, a), (1, b)] if (a - 2.0).abs() < 1e-9 && (b - 5.0).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn the_mean_is_that_of_the_circle_and_of_what_counts() {
        let mut swung = Swung { moments: vec![at(0.0, 179.0), at(0.0, -179.0)], ..Swung::default() };
        swung.moments.push(Moment { is_usable: false, ..at(0.0, 0.0) });
        let [before, after] = swung.take_out_the_mean();
        assert_eq!(before, None);
        assert!((after.unwrap().abs() - 180.0).abs() < 1e-9);
        let errors: Vec<f64> = swung.moments.iter().map(|moment| moment.error_deg.unwrap()).collect();
        assert!((errors[0] + 1.0).abs() < 1e-9 && (errors[1] - 1.0).abs() < 1e-9, "{errors:?}");
    }

    #[test]
    fn thinning_keeps_the_bound() {
        let all: Vec<usize> = (0..1001).collect();
        assert_eq!(thinned(&all, 500).count(), 334);
        assert_eq!(thinned(&all, 2000).count(), 1001);
        assert_eq!(thinned(&all[..0], 5).count(), 0);
        assert!((most_of([1.0, -2.0, f64::NAN, 3.0, -100.0].into_iter(), 0.67) - 3.0).abs() < 1e-9);
        assert!(largest([1.0, -2.0, f64::NAN].into_iter()) < 2.1);
    }
}
