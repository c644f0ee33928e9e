use super::*;
use crate::clock;
use crate::simulation::{Ended, Level, Simulation};

const OLD: [u8; 8] = *b"old word";

/// Runs one access to the end and returns its result.
fn run<T: 'static>(simulation: &mut Simulation, access: impl Future<Output = T> + 'static) -> Option<T> {
    let result = Rc::new(RefCell::new(None));
    let slot = Rc::clone(&result);
    simulation.spawn(Level::Thread, "access", async move {
        let value = access.await;
        *slot.borrow_mut() = Some(value);
    });
    simulation.run_for(10_000_000);
    result.take()
}

async fn write(mut flash: Flash, offset: u32, bytes: Vec<u8>) -> Result<(), FlashError> {
    flash.write(offset, &bytes).await
}

async fn erase(mut flash: Flash, from: u32, to: u32) -> Result<(), FlashError> {
    flash.erase(from, to).await
}

#[test]
fn a_word_is_programmed_once_per_erase() {
    let mut simulation = Simulation::new();
    let flash = Flash::new(2, 1);
    let mut program = |word: [u8; 8]| run(&mut simulation, write(flash.clone(), 8, word.to_vec())).unwrap();
    // All ones too: the code of the double word is then programmed.
    assert_eq!(program([0xFF; 8]), Ok(()));
    assert_eq!(program(OLD), Err(FlashError::NotErased { offset: 8 }));
    assert_eq!(run(&mut simulation, erase(flash.clone(), 0, 2048)), Some(Ok(())));
    assert_eq!(run(&mut simulation, write(flash.clone(), 8, OLD.to_vec())), Some(Ok(())));
    assert_eq!(flash.contents()[8..16], OLD);
    assert_eq!(flash.wear(), Wear { erases: 1, writes: 2, worst_page_erases: 1 });
}

#[test]
fn alignment_and_bounds_are_enforced() {
    let mut simulation = Simulation::new();
    let flash = Flash::new(2, 1);
    let mut zeros = |offset, length| run(&mut simulation, write(flash.clone(), offset, vec![0; length])).unwrap();
    assert_eq!(zeros(4, 8), Err(FlashError::NotAligned));
    assert_eq!(zeros(0, 12), Err(FlashError::NotAligned));
    assert_eq!(zeros(4096, 8), Err(FlashError::OutOfBounds));
    assert_eq!(zeros(u32::MAX - 7, 16), Err(FlashError::OutOfBounds));
    let mut clear = |from, to| run(&mut simulation, erase(flash.clone(), from, to)).unwrap();
    assert_eq!(clear(0, 1024), Err(FlashError::NotAligned));
    assert_eq!(clear(2048, 6144), Err(FlashError::OutOfBounds));
    assert_eq!(clear(2048, 0), Err(FlashError::OutOfBounds));
    assert_eq!(flash.wear(), Wear::default());
}

/// STM32L475 data sheet: 81.7 us a double word, 22.0 ms a page.
#[test]
fn operations_take_their_time() {
    let mut simulation = Simulation::new();
    let flash = Flash::new(2, 1);
    let timed = run(&mut simulation, async move {
        let start_us = clock::now_us();
        write(flash.clone(), 0, vec![0; 24]).await.unwrap();
        let written_us = clock::now_us();
        erase(flash, 0, 4096).await.unwrap();
        (written_us - start_us, clock::now_us() - written_us)
    });
    assert_eq!(timed, Some((3 * 82, 2 * 22_000)));
}

#[test]
fn a_cut_strikes_at_the_chosen_operation_and_ends_the_run() {
    for outcome in CutOutcome::ALL {
        let mut simulation = Simulation::new();
        let flash = Flash::new(1, 7);
        flash.cut_power_after(1, outcome, simulation.stop());
        let task = write(flash.clone(), 0, [OLD, OLD, OLD].concat());
        simulation.spawn(Level::Thread, "write", async move {
            assert_eq!(task.await, Err(FlashError::PowerLost));
        });
        assert_eq!(simulation.run_for(1_000_000), Ended::Stopped);
        assert!(!flash.is_powered());
        assert_eq!(run(&mut simulation, erase(flash.clone(), 0, 2048)), Some(Err(FlashError::PowerLost)));

        flash.power_on();
        let bytes = flash.contents();
        assert_eq!(bytes[0..8], OLD, "what was done before the cut stays");
        assert_eq!(bytes[16..24], [0xFF; 8], "what would have come after it never happens");
        let second: [u8; 8] = bytes[8..16].try_into().unwrap();
        match outcome {
            CutOutcome::NotBegun => assert_eq!(second, [0xFF; 8]),
            CutOutcome::Done => assert_eq!(second, OLD),
            CutOutcome::Torn => {
                assert!(second != OLD && second != [0xFF; 8], "seed 7 leaves some bits fallen, some not");
                let never_rise = second.iter().zip(OLD).all(|(torn, wanted)| torn & wanted == wanted);
                assert!(never_rise, "a bit that should stay one was cleared");
            }
        }
        let again = run(&mut simulation, write(flash.clone(), 8, OLD.to_vec())).unwrap();
        assert_eq!(again.is_ok(), outcome == CutOutcome::NotBegun, "a touched word needs an erase");
    }
}

#[test]
fn dropping_the_task_tears_what_it_waited_for() {
    let mut simulation = Simulation::new();
    let flash = Flash::new(2, 3);
    assert_eq!(run(&mut simulation, write(flash.clone(), 0, OLD.repeat(256))), Some(Ok(())));
    let erasing = erase(flash.clone(), 0, 2048);
    simulation.spawn(Level::Thread, "erase", async move {
        erasing.await.unwrap();
    });
    simulation.run_for(10_000);
    simulation.power_off();

    let page = flash.contents();
    let (words, _) = page[..2048].as_chunks::<8>();
    let old = words.iter().filter(|&&word| word == OLD).count();
    let erased = words.iter().filter(|&&word| word == [0xFF; 8]).count();
    // A third of 256 words each, with a standard deviation of 7.5; four of them either way.
    assert!((55..=116).contains(&old), "{old} words as before");
    assert!((55..=116).contains(&erased), "{erased} words erased");
    assert_eq!(run(&mut simulation, erase(flash.clone(), 0, 2048)), Some(Ok(())));
    assert_eq!(flash.contents()[..2048], [0xFF; 2048], "erasing again mends the page");
}
