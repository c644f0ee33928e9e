//! Compasses of one aircraft against each other: two that agree are evidence about a third.

use std::fmt;

use super::evaluation::CompassEvaluation;
use crate::numbers::rms;
use crate::replay::row::ReplayRow;
use crate::score::{BAD_COMPASS_RMS_DEG, wrap_180};

/// Largest difference of two compasses that agree, degrees RMS: both are good.
const MAX_AGREEMENT_DEG: f64 = 3.0;
/// Largest difference in time of rows that are compared, seconds: half a row at 10 Hz.
const MAX_TIME_DIFFERENCE_S: f64 = 0.06;
/// Least number of rows that are compared: 5 s at 10 Hz.
const MIN_ROWS: usize = 50;

/// Difference of a compass from two that agree; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Numbers of the two that agree.
    pub agreeing: [u8; 2],
    /// Difference of their headings as logged, degrees RMS.
    pub agreement_deg: f64,
    /// Difference of the compass from the nearer of them, mean included, degrees RMS.
    pub difference_deg: f64,
}

/// Difference of a bad compass from two others that agree; none if it agrees, or no two others do.
pub(super) fn disagreement(compasses: &[CompassEvaluation], compass: &CompassEvaluation) -> Option<Disagreement> {
    let others: Vec<&CompassEvaluation> =
        compasses.iter().filter(|other| other.compass_number != compass.compass_number).collect();
    let pairs = others.iter().enumerate().flat_map(|(i, one)| others[i + 1..].iter().map(move |other| [*one, *other]));
    let agreeing = pairs.filter_map(|pair| Some((pair, difference_deg(&pair[0].rows, &pair[1].rows)?)));
    let (pair, agreement_deg) = agreeing.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let differences = pair.map(|other| difference_deg(&compass.rows, &other.rows));
    let difference_deg = differences[0]?.min(differences[1]?);
    (agreement_deg <= MAX_AGREEMENT_DEG && difference_deg > BAD_COMPASS_RMS_DEG).then_some(Disagreement {
        agreeing: pair.map(|other| other.compass_number),
        agreement_deg,
        difference_deg,
    })
}

/// Difference of headings as logged at the same time, degrees RMS.
fn difference_deg(rows: &[ReplayRow], others: &[ReplayRow]) -> Option<f64> {
    let at_same_time = rows.iter().filter(|row| row.is_usable).filter_map(|row| {
        let next = others.partition_point(|other| other.t_s < row.t_s - MAX_TIME_DIFFERENCE_S);
        others
            .get(next)
            .filter(|other| other.is_usable && other.t_s <= row.t_s + MAX_TIME_DIFFERENCE_S)
            .map(|other| (row, other))
    });
    let differences_deg: Vec<f64> = at_same_time
        .map(|(row, other)| wrap_180(row.logged_heading_deg() - other.logged_heading_deg()))
        .filter(|difference_deg| difference_deg.is_finite())
        .collect();
    (differences_deg.len() >= MIN_ROWS).then(|| rms(differences_deg))
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { agreeing: [one, other], agreement_deg, difference_deg } = self;
        write!(
            f,
            "differs by {difference_deg:.0} deg RMS from compasses {one} and {other}, which agree within {agreement_deg:.1}"
        )
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::replay::tests::compass_of_flown_turns;

    /// Iron of 12 uT at 31 uT horizontal bends the headings of the third of four compasses.
    #[test]
    fn a_compass_that_differs_from_two_that_agree_is_named() {
        let (_, compass) = compass_of_flown_turns();
        let with_iron = |compass_number, forward_ut: f32| {
            let mut compass = CompassEvaluation { compass_number, ..compass.clone() };
            compass.rows.iter_mut().for_each(|row| row.logged_field.ut += Vector3::new(forward_ut, 0.0, 0.0));
            compass
        };
        let found = |irons_ut: &[f32], index: usize| {
            let compasses: Vec<_> = (1..).zip(irons_ut).map(|(number, iron_ut)| with_iron(number, *iron_ut)).collect();
            disagreement(&compasses, &compasses[index])
        };
        let third = found(&[0.0, 0.5, 12.0], 2).unwrap();
        assert_eq!(third.agreeing, [1, 2]);
        assert!(third.difference_deg > 8.0 && third.agreement_deg < 1.0, "{third:?}");
        assert_eq!((found(&[0.0, 0.5, 12.0], 0), found(&[0.0, 0.5, 1.0], 2)), (None, None));
        assert_eq!((found(&[0.0, 12.0], 1), found(&[0.0, -9.0, 12.0], 2)), (None, None));
    }
}
