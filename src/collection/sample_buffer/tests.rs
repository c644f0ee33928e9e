use super::super::test_samples::test_sample;
use super::*;

const PARTS: [CollectionPart; 3] = [CollectionPart::LEFT, CollectionPart::LEVEL, CollectionPart::FREE];

fn insert_test_sample(buffer: &mut SampleBuffer, sample_use: SampleUse, part: CollectionPart, time_ms: u32) {
    buffer.insert_sample(sample_use, Sample { part, ..test_sample([1.0; 3], time_ms) });
}

fn times_ms(samples: &[Sample]) -> Vec<u32> {
    samples.iter().map(|sample| sample.time.as_ms()).collect()
}

/// Fit and held-back samples of three parts, stored in turn.
fn filled_buffer() -> SampleBuffer {
    let mut buffer = SampleBuffer::EMPTY;
    for time_ms in (0..60).step_by(10) {
        for (i, part) in PARTS.into_iter().enumerate() {
            let sample_use = if time_ms % 20 == 0 { SampleUse::Fit } else { SampleUse::Verification };
            insert_test_sample(&mut buffer, sample_use, part, time_ms + i as u32);
        }
    }
    buffer
}

#[test]
fn samples_are_ordered_by_use_part_and_time() {
    let buffer = filled_buffer();
    assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Fit)), [0, 20, 40, 1, 21, 41, 2, 22, 42]);
    assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Verification)), [10, 30, 50, 11, 31, 51, 12, 32, 52]);
    assert_eq!(
        times_ms(buffer.all_samples()),
        [times_ms(buffer.samples_of_use(SampleUse::Fit)), times_ms(buffer.samples_of_use(SampleUse::Verification))]
            .concat()
    );
    assert_eq!(times_ms(buffer.samples_of_part(SampleUse::Fit, CollectionPart::LEVEL)), [1, 21, 41]);
    assert_eq!(times_ms(buffer.samples_of_part(SampleUse::Verification, CollectionPart::FREE)), [12, 32, 52]);
    assert!(buffer.samples_of_part(SampleUse::Fit, CollectionPart::RIGHT).is_empty());
    for (i, part) in PARTS.into_iter().enumerate() {
        let both: Vec<Sample> = buffer.part_fit_then_held_back(part).iter().copied().collect();
        assert_eq!(times_ms(&both), [0, 20, 40, 10, 30, 50].map(|time_ms| time_ms + i as u32));
    }
}

#[test]
fn removing_a_sample_leaves_the_others_in_order() {
    for (sample_use, part, position, removed) in [
        (SampleUse::Fit, CollectionPart::LEFT, 0, 0),
        (SampleUse::Fit, CollectionPart::FREE, 2, 42),
        (SampleUse::Verification, CollectionPart::LEFT, 1, 30),
        (SampleUse::Verification, CollectionPart::FREE, 2, 52),
    ] {
        let (before, mut buffer) = (filled_buffer(), filled_buffer());
        buffer.remove_sample(sample_use, part, position);
        for use_of in [SampleUse::Fit, SampleUse::Verification] {
            let expected: Vec<u32> =
                times_ms(before.samples_of_use(use_of)).into_iter().filter(|time| *time != removed).collect();
            assert_eq!(times_ms(buffer.samples_of_use(use_of)), expected, "{removed}");
        }
    }
    let mut buffer = filled_buffer();
    buffer.remove_sample(SampleUse::Fit, CollectionPart::LEFT, 3);
    buffer.remove_sample(SampleUse::Fit, CollectionPart::RIGHT, 0);
    assert_eq!(buffer.all_samples(), filled_buffer().all_samples(), "there is none");
}

#[test]
fn a_replacement_changes_its_part_only() {
    let mut buffer = filled_buffer();
    let new = |part, time_ms| Sample { part, ..test_sample([2.0; 3], time_ms) };
    buffer.replace_sample(SampleUse::Fit, 1, 3, new(CollectionPart::LEVEL, 99));
    assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Fit)), [0, 20, 40, 1, 41, 99, 2, 22, 42]);
    buffer.replace_sample(SampleUse::Verification, 0, 3, new(CollectionPart::FREE, 98));
    assert_eq!(times_ms(buffer.samples_of_use(SampleUse::Verification)), [10, 30, 50, 11, 31, 51, 32, 52, 98]);
    let before = buffer.clone();
    buffer.replace_sample(SampleUse::Fit, 3, 3, new(CollectionPart::LEVEL, 97));
    assert_eq!(buffer.all_samples(), before.all_samples(), "there is none");
}

#[test]
fn a_full_buffer_accepts_no_more() {
    let mut buffer = SampleBuffer::EMPTY;
    for time_ms in 0..SAMPLE_CAPACITY as u32 + 5 {
        insert_test_sample(
            &mut buffer,
            if time_ms % 4 == 3 { SampleUse::Verification } else { SampleUse::Fit },
            CollectionPart::FREE,
            time_ms,
        );
    }
    assert_eq!(buffer.all_samples().len(), SAMPLE_CAPACITY);
    assert!(
        times_ms(buffer.samples_of_use(SampleUse::Fit)).is_sorted()
            && times_ms(buffer.samples_of_use(SampleUse::Verification)).is_sorted()
    );
    buffer.clear();
    assert!(buffer.all_samples().is_empty() && buffer.samples_of_use(SampleUse::Verification).is_empty());
}

/// Memory has arbitrary numbers at power-on.
#[test]
fn numbers_beyond_the_capacity_are_an_empty_buffer() {
    for (fit_count, held_back_count) in
        [(SAMPLE_CAPACITY as u16 + 1, 0), (1, SAMPLE_CAPACITY as u16), (u16::MAX, u16::MAX)]
    {
        let mut buffer = SampleBuffer { fit_count, held_back_count, ..filled_buffer() };
        assert!(
            [SampleUse::Fit, SampleUse::Verification]
                .iter()
                .all(|sample_use| buffer.samples_of_use(*sample_use).is_empty())
        );
        buffer.remove_sample(SampleUse::Verification, CollectionPart::FREE, 0);
        buffer.replace_sample(SampleUse::Verification, 0, 1, test_sample([0.0; 3], 2));
        buffer.clear();
        insert_test_sample(&mut buffer, SampleUse::Fit, CollectionPart::FREE, 3);
        assert_eq!(times_ms(buffer.all_samples()), [3]);
    }
}
