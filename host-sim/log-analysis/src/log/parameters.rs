//! An autopilot's parameters over time.

use std::collections::BTreeMap;

/// Largest number of parameters.
const MAX_PARAMETERS: usize = 8192;

const MAX_CHANGES_PER_PARAMETER: usize = 256;

/// Values by name, each valid from its time on. The first value also holds before its time, since a link sends it late.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParameterHistory(BTreeMap<String, Vec<(f64, f64)>>);

impl ParameterHistory {
    /// Stores a value received at a time in seconds.
    pub fn set_value(&mut self, t_s: f64, name: &str, value: f64) {
        if !value.is_finite() || name.is_empty() || name.len() > 32 {
            return;
        }
        if let Some(values) = self.0.get_mut(name) {
            let is_new = values.last().is_none_or(|&(_, last)| last.total_cmp(&value).is_ne());
            if is_new && values.len() < MAX_CHANGES_PER_PARAMETER {
                values.push((t_s, value));
            }
        } else if self.0.len() < MAX_PARAMETERS {
            self.0.insert(name.to_owned(), vec![(t_s, value)]);
        }
    }

    /// Inserts a value that is valid from a time on, until the next one.
    pub fn insert_value(&mut self, t_s: f64, name: &str, value: f64) {
        let Some(values) = self.0.get_mut(name) else { return self.set_value(t_s, name, value) };
        if value.is_finite() && values.len() < MAX_CHANGES_PER_PARAMETER {
            values.insert(values.partition_point(|&(from_s, _)| from_s <= t_s), (t_s, value));
        }
    }

    /// Replaces all values of a parameter.
    pub fn replace_value(&mut self, name: &str, value: f64) {
        self.0.remove(name);
        self.set_value(f64::NEG_INFINITY, name, value);
    }

    /// The value at a time.
    pub fn value_at(&self, t_s: f64, name: &str) -> Option<f64> {
        let values = self.0.get(name)?;
        let latest = values.iter().take_while(|&&(from_s, _)| from_s <= t_s).last();
        latest.or_else(|| values.first()).map(|&(_, value)| value)
    }

    /// The last value of a parameter.
    pub fn last_value(&self, name: &str) -> Option<f64> {
        self.value_at(f64::INFINITY, name)
    }

    /// Time of a parameter's last change, seconds; none if it never changed.
    pub fn last_change_s(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.iter().skip(1).last().map(|&(t_s, _)| t_s)
    }

    /// Times at which any parameter with a prefix changed, seconds, in order.
    pub fn change_times_s(&self, prefix: &str) -> Vec<f64> {
        let histories = self.0.iter().filter(|(name, _)| name.starts_with(prefix));
        let mut times: Vec<f64> =
            histories.flat_map(|(_, values)| values.iter().skip(1).map(|&(t_s, _)| t_s)).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// Whether any parameter has a name with this prefix.
    pub fn has_prefix(&self, prefix: &str) -> bool {
        self.0.range(prefix.to_owned()..).next().is_some_and(|(name, _)| name.starts_with(prefix))
    }

    /// Names of the parameters whose last value is this one.
    pub fn names_with_value(&self, value: f64) -> impl Iterator<Item = &str> {
        let matches = move |(_, values): &(&String, &Vec<(f64, f64)>)| {
            values.last().is_some_and(|&(_, last)| last.total_cmp(&value).is_eq())
        };
        self.0.iter().filter(matches).map(|(name, _)| name.as_str())
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
impl ParameterHistory {
    /// History of constant values.
    pub(crate) fn of_values(values: &[(&str, f64)]) -> Self {
        let mut parameters = Self::default();
        for &(name, value) in values {
            parameters.set_value(0.0, name, value);
        }
        parameters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_value_applies_from_the_start_and_a_change_from_its_time() {
        let mut parameters = ParameterHistory::default();
        for (t_s, value) in [(5.0, 1.0), (6.0, 1.0), (10.0, 2.0)] {
            parameters.set_value(t_s, "COMPASS_OFS_X", value);
        }
        let value_at = |t_s| parameters.value_at(t_s, "COMPASS_OFS_X");
        assert_eq!([0.0, 9.9, 10.0, 99.0].map(value_at), [1.0, 1.0, 2.0, 2.0].map(Some));
        assert_eq!(parameters.change_times_s("COMPASS_"), [10.0]);
        assert!(parameters.change_times_s("AHRS").is_empty());
        assert_eq!(parameters.last_value("COMPASS_OFS_Y"), None);
        parameters.set_value(11.0, "COMPASS_OFS", 2.0);
        assert_eq!(
            ["COMPASS_OFS_X", "COMPASS_OFS", "AHRS"].map(|name| parameters.last_change_s(name)),
            [Some(10.0), None, None]
        );
    }
}
