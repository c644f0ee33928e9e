//! Any bytes on any wire: every decoder gets frames that are whole, damaged, cut and joined, and noise between them. Nothing
//! panics, what a byte costs is bounded, nothing is believed whose CRC is wrong, and what is good is understood again.
//!
//! A million inputs each where this is built with optimisation, ten thousand in a debug build, where arithmetic that overflows
//! panics, too; AUTOSWING_FUZZ_INPUTS is another number:
//!
//! ```sh
//! AUTOSWING_FUZZ_INPUTS=100000000 cargo test --release --test fuzz mavlink
//! ```
//!
//! The same number gives the same inputs. One that fails is made smaller and printed; it is a value that a test can be made of.
//! NMEA has no decoder: the module hears no sentences.

mod console;
mod mavlink;
mod msp;
mod port;
mod store;
mod stream;

use std::fmt::Debug;

use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

fn inputs() -> u32 {
    const BY_ITSELF: u32 = if cfg!(debug_assertions) { 10_000 } else { 1_000_000 };
    match std::env::var("AUTOSWING_FUZZ_INPUTS") {
        Ok(number) => number.parse().expect("AUTOSWING_FUZZ_INPUTS is a number of inputs"),
        Err(_) => BY_ITSELF,
    }
}

/// What an input must not break.
type Promise = Result<(), TestCaseError>;

/// So many inputs, of a seed: not of the system's entropy, which is what a runner begins with by itself.
fn runner(cases: u32) -> TestRunner {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]))
}

/// Holds a promise against so many inputs of a kind.
fn hold<S: Strategy<Value: Debug>>(kind: S, promise: impl Fn(S::Value) -> Promise) {
    let mut runner = runner(inputs());
    if let Err(failure) = runner.run(&kind, promise) {
        panic!("{failure}");
    }
}

/// Another number of the same seed would be another input: what is found today is found tomorrow.
#[test]
fn one_seed_gives_the_same_inputs() {
    let all = || {
        let all = std::cell::RefCell::new(Vec::new());
        let mut runner = runner(100);
        let keep = |bytes| {
            all.borrow_mut().push(bytes);
            Ok(())
        };
        runner.run(&mavlink::stream(), keep).expect("nothing is promised");
        all.into_inner()
    };
    assert_eq!(all(), all());
}
