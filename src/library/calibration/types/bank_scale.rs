//! Bank-angle scale error of an attitude source.

/// Finding: bank-angle scale error of an attitude source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankScaleFinding {
    /// Ratio of reported to true bank; 1 is correct.
    pub reported_bank_ratio: f32,
    /// Distance from 1 in sigmas, the allowance for good sources included.
    pub significance_sigmas: f32,
}
