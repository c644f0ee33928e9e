//! Functions of the WebAssembly module. The worker writes a request into the buffer of [`request_buffer`], calls
//! [`open_log`], [`open_example`], [`judge_log`] or [`fly_example`], and reads the answer: JSON, with `error` if the request failed.

use std::cell::RefCell;
use std::io::{self, Read};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use crate::example_flight;
use crate::loaded_log::{LoadedLog, RequestFailure};

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Copies the next bytes of the log to `into`, at most `length`; returns their number, 0 at the end of the log, and
    /// `usize::MAX` if the file cannot be read.
    fn copy_log_bytes(into: *mut u8, length: usize) -> usize;

    /// Receives a step of the example flight: JSON of `length` bytes.
    fn report_step(json: *const u8, length: usize);
}

/// The file that the worker reads.
struct PageFile;

impl Read for PageFile {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        // SAFETY: the worker writes at most `length` bytes, and `into` has that length.
        match unsafe { copy_log_bytes(into.as_mut_ptr(), into.len()) } {
            usize::MAX => Err(io::Error::other("the browser cannot read the file")),
            number => Ok(number.min(into.len())),
        }
    }
}

#[derive(Default)]
struct PageState {
    request: Vec<u8>,
    answer: Vec<u8>,
    log: Option<LoadedLog>,
}

thread_local! {
    static PAGE_STATE: RefCell<PageState> = RefCell::default();
}

impl PageState {
    fn parse_request<T: DeserializeOwned>(&self) -> Result<T, String> {
        serde_json::from_slice(&self.request).map_err(|error| error.to_string())
    }

    fn open_log(&mut self) -> Result<impl Serialize + use<>, RequestFailure> {
        self.log = None;
        let log = LoadedLog::read_log(&mut PageFile, self.parse_request()?)?;
        Ok(self.log.insert(log).log_summary())
    }

    fn open_example(&mut self) -> Result<impl Serialize + use<>, RequestFailure> {
        let log = example_flight::record_example()?;
        Ok(self.log.insert(log).log_summary())
    }

    fn judge_log(&self) -> Result<impl Serialize + use<>, String> {
        let log = self.log.as_ref().ok_or("no log is open")?;
        log.judge_log(&self.parse_request()?)
    }

    fn fly_example(&self) -> Result<impl Serialize + use<>, String> {
        let request = self.parse_request()?;
        Ok(example_flight::fly_example(request, &mut |step| {
            let json = serde_json::to_vec(step).unwrap_or_default();
            // SAFETY: the worker reads `length` bytes before it returns.
            unsafe { report_step(json.as_ptr(), json.len()) }
        }))
    }

    fn set_answer(&mut self, result: Result<impl Serialize, impl Into<RequestFailure>>) {
        let answer = result
            .map_err(Into::into)
            .and_then(|answer| serde_json::to_vec(&answer).map_err(|error| RequestFailure::from(error.to_string())));
        self.answer = answer.unwrap_or_else(|failure| json!(failure).to_string().into_bytes());
    }
}

/// Buffer for a request of `length` bytes.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn request_buffer(length: usize) -> *mut u8 {
    PAGE_STATE.with_borrow_mut(|state| {
        state.request.clear();
        state.request.resize(length, 0);
        state.request.as_mut_ptr()
    })
}

/// Reads a log: a `LogRequest`, answered by a `LogSummary`.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn open_log() {
    PAGE_STATE.with_borrow_mut(|state| {
        let result = state.open_log();
        state.set_answer(result);
    });
}

/// Opens the log of a simulated flight, answered by a `LogSummary`.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn open_example() {
    PAGE_STATE.with_borrow_mut(|state| {
        let result = state.open_example();
        state.set_answer(result);
    });
}

/// Judges the log: `PageChoices`, answered by a `JudgedLog`.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn judge_log() {
    PAGE_STATE.with_borrow_mut(|state| {
        let result = state.judge_log();
        state.set_answer(result);
    });
}

/// Flies the example aircraft: a `FlightRequest`, answered by a `FlownExample`, after a `FlightStep` for each step.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn fly_example() {
    PAGE_STATE.with_borrow_mut(|state| {
        let result = state.fly_example();
        state.set_answer(result);
    });
}

/// First byte of the answer.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn answer() -> *const u8 {
    PAGE_STATE.with_borrow(|state| state.answer.as_ptr())
}

/// Length of the answer, bytes.
// SAFETY: no other linked function has this name.
#[unsafe(no_mangle)]
extern "C" fn answer_length() -> usize {
    PAGE_STATE.with_borrow(|state| state.answer.len())
}
