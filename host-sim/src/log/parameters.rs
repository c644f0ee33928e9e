//! An autopilot's parameters, and when they were what.

use std::collections::BTreeMap;

/// No autopilot has more; what a file says beyond is passed over.
const MAX_NAMES: usize = 8192;

/// Changes of one parameter that are kept.
const MAX_CHANGES: usize = 256;

/// Parameters by name, with the time from which on each value holds. The first value that is told holds before that, too:
/// on a link it is told late.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters(BTreeMap<String, Vec<(f64, f64)>>);

impl Parameters {
    /// Takes a value that is told at an instant, seconds.
    pub fn set(&mut self, t_s: f64, name: &str, value: f64) {
        if !value.is_finite() || name.is_empty() || name.len() > 32 {
            return;
        }
        if let Some(values) = self.0.get_mut(name) {
            let is_new = values.last().is_none_or(|&(_, last)| last.total_cmp(&value).is_ne());
            if is_new && values.len() < MAX_CHANGES {
                values.push((t_s, value));
            }
        } else if self.0.len() < MAX_NAMES {
            self.0.insert(name.to_owned(), vec![(t_s, value)]);
        }
    }

    /// The value at an instant.
    #[must_use]
    pub fn at(&self, t_s: f64, name: &str) -> Option<f64> {
        let values = self.0.get(name)?;
        let told = values.iter().take_while(|&&(from_s, _)| from_s <= t_s).last();
        told.or_else(|| values.first()).map(|&(_, value)| value)
    }

    /// The last value.
    #[must_use]
    pub fn last(&self, name: &str) -> Option<f64> {
        self.at(f64::INFINITY, name)
    }

    /// When a parameter last changed after it was first told, seconds.
    #[must_use]
    pub fn changed_s(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.iter().skip(1).last().map(|&(t_s, _)| t_s)
    }

    /// When any parameter whose name begins so changed after it was first told, seconds, in order.
    #[must_use]
    pub fn changes_s(&self, prefix: &str) -> Vec<f64> {
        let of = self.0.iter().filter(|(name, _)| name.starts_with(prefix));
        let mut times: Vec<f64> = of.flat_map(|(_, values)| values.iter().skip(1).map(|&(t_s, _)| t_s)).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_value_holds_before_it_was_told_and_a_change_from_its_time_on() {
        let mut parameters = Parameters::default();
        for (t_s, value) in [(5.0, 1.0), (6.0, 1.0), (10.0, 2.0)] {
            parameters.set(t_s, "COMPASS_OFS_X", value);
        }
        let at = |t_s| parameters.at(t_s, "COMPASS_OFS_X");
        assert_eq!([0.0, 9.9, 10.0, 99.0].map(at), [1.0, 1.0, 2.0, 2.0].map(Some));
        assert_eq!(parameters.changes_s("COMPASS_"), [10.0]);
        assert!(parameters.changes_s("AHRS").is_empty());
        assert_eq!(parameters.last("COMPASS_OFS_Y"), None);
        parameters.set(11.0, "COMPASS_OFS", 2.0);
        assert_eq!(
            ["COMPASS_OFS_X", "COMPASS_OFS", "AHRS"].map(|name| parameters.changed_s(name)),
            [Some(10.0), None, None]
        );
    }
}
