//! `host-sim completions` and `host-sim man`.

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Command};
use clap_complete::Shell;

use super::command_failure::CommandFailure;
use super::print;

const PROGRAM_NAME: &str = "host-sim";

/// Print a shell's completions of commands and options.
///
/// For bash, for instance: host-sim completions bash >
/// ~/.local/share/bash-completion/completions/host-sim
#[derive(Args)]
pub struct CompletionsOptions {
    /// The shell
    shell: Shell,
}

/// Write the manual pages, one per command.
///
/// For the pages of one user: host-sim man ~/.local/share/man/man1; then: man host-sim
#[derive(Args)]
pub struct ManOptions {
    /// Folder for the pages; made if missing
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Prints the completions of a command line.
pub fn write_completions(options: &CompletionsOptions, mut command_line: Command) -> ExitCode {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut command_line, PROGRAM_NAME, &mut script);
    print::print_bytes(&script);
    ExitCode::SUCCESS
}

/// Writes the manual pages of a command line.
///
/// # Errors
///
/// The folder cannot be made or written.
pub fn write_man_pages(options: &ManOptions, command_line: Command) -> Result<ExitCode, CommandFailure> {
    let folder = &options.folder;
    fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command_line, folder))
        .map_err(|error| CommandFailure(format!("{}: {error}", folder.display())))?;
    print::print_line(format_args!("pages: {}", folder.display()));
    Ok(ExitCode::SUCCESS)
}
