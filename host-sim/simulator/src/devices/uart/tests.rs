use super::*;
use testkit::simulation::{Level, Simulation};

type ReadLog<T> = Rc<RefCell<Vec<T>>>;

fn spawn_reader(simulation: &mut Simulation, mut receiver: Receiver) -> ReadLog<(u64, Result<Vec<u8>, UartError>)> {
    let log = ReadLog::default();
    let reads = Rc::clone(&log);
    simulation.spawn(Level::Thread, "reader", async move {
        let mut buffer = [0; 64];
        loop {
            let result = receiver.read(&mut buffer).await.map(|count| buffer[..count].to_vec());
            reads.borrow_mut().push((clock::now_us(), result));
        }
    });
    log
}

/// At 115,200 baud 10 bits take 86.806 us; arrival times are rounded up to microseconds.
#[test]
fn bytes_arrive_at_the_baud_rate_to_the_microsecond() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig { wake_condition: WakeCondition::EachByte, ..UartConfig::default() });
    let (receiver, _transmitter) = cable.module_ends();
    let reads = spawn_reader(&mut simulation, receiver);
    cable.host_end().send_bytes(b"ab");
    simulation.run_until(1000);
    cable.host_end().send_bytes(b"c");
    simulation.run_until(2000);
    let expected = [(87, b"a"), (174, b"b"), (1087, b"c")].map(|(at_us, byte)| (at_us, Ok(byte.to_vec())));
    assert_eq!(*reads.borrow(), expected);
}

#[test]
fn a_thousand_bytes_keep_the_exact_rate() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig { transmit_buffer_bytes: 2000, ..UartConfig::default() });
    let (_receiver, mut transmitter) = cable.module_ends();
    simulation.spawn(Level::Thread, "writer", async move {
        transmitter.write_all(&[0x55; 1000]).await.unwrap();
        transmitter.flush().await.unwrap();
        assert_eq!(clock::now_us(), 86_806, "10,000 bits at 115,200 a second");
        std::future::pending::<()>().await;
    });
    simulation.run_until(86_805);
    assert_eq!(cable.host_end().receive_bytes().len(), 999);
    simulation.run_until(86_806);
    assert_eq!(cable.host_end().receive_timed(), [TimedByte { arrives_at_us: 86_806, byte: 0x55 }]);
}

/// A DMA receiver delivers a burst one byte time after its end: 3 x 87 us.
#[test]
fn idle_line_delivers_bursts_whole() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig { receive_buffer_bytes: 8, ..UartConfig::default() });
    let (receiver, _transmitter) = cable.module_ends();
    let reads = spawn_reader(&mut simulation, receiver);
    cable.host_end().send_bytes(b"ab");
    simulation.run_until(5000);
    cable.host_end().send_bytes(b"cdefgh");
    simulation.run_until(10_000);
    let reads = reads.borrow();
    assert_eq!(reads[0], (261, Ok(b"ab".to_vec())));
    assert_eq!(reads[1], (5348, Ok(b"cdef".to_vec())), "half of the buffer is full");
    assert_eq!(reads[2], (5608, Ok(b"gh".to_vec())));
}

#[test]
fn a_slow_reader_loses_the_newest_bytes_and_gets_one_overrun() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig { receive_buffer_bytes: 4, ..UartConfig::default() });
    let (receiver, _transmitter) = cable.module_ends();
    cable.host_end().send_bytes(b"abcdefg");
    simulation.run_until(10_000);
    let reads = spawn_reader(&mut simulation, receiver);
    simulation.run_until(20_000);
    let results: Vec<_> = reads.borrow().iter().map(|(_, result)| result.clone()).collect();
    assert_eq!(results, [Err(UartError::Overrun), Ok(b"abcd".to_vec())]);
    assert_eq!(cable.host_end().lost_bytes(), 3);
}

#[test]
fn an_injected_error_wakes_the_reader() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig::default());
    let (receiver, _transmitter) = cable.module_ends();
    let reads = spawn_reader(&mut simulation, receiver);
    simulation.run_until(500);
    cable.host_end().inject_error(UartError::Framing);
    simulation.run_until(600);
    assert_eq!(*reads.borrow(), [(500, Err(UartError::Framing))]);
}

#[test]
fn a_write_waits_while_the_transmit_buffer_is_full() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig { transmit_buffer_bytes: 2, ..UartConfig::default() });
    let (_receiver, mut transmitter) = cable.module_ends();
    simulation.spawn(Level::Thread, "writer", async move {
        transmitter.write_all(b"abcd").await.unwrap();
        assert_eq!(clock::now_us(), 174, "the fourth byte is accepted when the second is out");
        std::future::pending::<()>().await;
    });
    simulation.run_until(1000);
    assert_eq!(cable.host_end().receive_bytes(), b"abcd");
}

#[test]
fn power_off_truncates_output_and_discards_received_bytes() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig::default());
    let (receiver, mut transmitter) = cable.module_ends();
    simulation.spawn(Level::Thread, "writer", async move {
        transmitter.write_all(b"$HCHDM,1").await.unwrap();
        std::future::pending::<()>().await;
    });
    simulation.run_until(300);
    simulation.power_off();
    drop(receiver);
    cable.host_end().send_bytes(b"lost");
    simulation.run_until(10_000);
    assert_eq!(cable.host_end().receive_bytes(), b"$HC", "three bytes of 86.8 us fit into 300 us");

    let (receiver, _transmitter) = cable.module_ends();
    let reads = spawn_reader(&mut simulation, receiver);
    cable.host_end().send_bytes(b"new");
    simulation.run_until(20_000);
    assert_eq!(*reads.borrow(), [(10_000 + 261 + 87, Ok(b"new".to_vec()))]);
}

#[test]
fn the_host_side_can_wait_for_bytes() {
    let mut simulation = Simulation::new();
    let cable = SerialCable::new(UartConfig::default());
    let (_receiver, mut transmitter) = cable.module_ends();
    let host = cable.host_end();
    simulation.spawn(Level::World, "pilot", async move {
        host.wait_until_readable().await;
        assert_eq!((clock::now_us(), host.receive_bytes()), (1087, b"!".to_vec()));
    });
    simulation.spawn(Level::Thread, "writer", async move {
        Timer::after_micros(1000).await;
        transmitter.write_all(b"!").await.unwrap();
        std::future::pending::<()>().await;
    });
    simulation.run_until(5000);
    assert_eq!(simulation.task_count(), 1, "the pilot is done");
}
