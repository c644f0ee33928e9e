use super::Switch;

#[test]
fn a_switch_is_on_from_its_beginning_until_its_end() {
    let switch = Switch::off();
    assert!(!switch.is_on(0) && !switch.is_on(u64::MAX - 1));
    switch.act(1_000_000, 3_000_000);
    assert_eq!([999_999, 1_000_000, 2_999_999, 3_000_000].map(|us| switch.is_on(us)), [false, true, true, false]);
    assert_eq!(switch.on_for_s(2_500_000), Some(1.5));
    assert_eq!(switch.on_for_s(3_000_000), None);
    for (at_us, progress) in [(0, 0.0), (1_000_000, 0.0), (2_000_000, 0.5), (4_000_000, 1.0)] {
        assert!((switch.progress(at_us) - progress).abs() < 1e-9, "{at_us}");
    }
    assert!(Switch::on().is_on(0));
}
