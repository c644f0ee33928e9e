//! Writes shell completions and manual pages of `host-sim` and `lab`, for `scripts/release`: `shell_files FOLDER`.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

use clap::CommandFactory as _;
use clap_complete::Shell;

fn main() -> io::Result<()> {
    write_files(&env::args_os().nth(1).map_or_else(|| PathBuf::from("."), PathBuf::from))
}

fn write_files(folder: &Path) -> io::Result<()> {
    let pages = folder.join("man/man1");
    let completions = folder.join("completions");
    for made in [&pages, &completions] {
        fs::create_dir_all(made)?;
    }
    for mut program in [host_sim::commands::Cli::command(), laboratory::cli::Cli::command()] {
        let name = program.get_name().to_owned();
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::PowerShell] {
            clap_complete::generate_to(shell, &mut program, &name, &completions)?;
        }
        clap_mangen::generate_to(program, &pages)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    /// Bash reads the completions and offers a command; every command has its page.
    #[test]
    fn completions_and_manual_pages_name_every_command() {
        let folder = tempfile::tempdir().unwrap();
        super::write_files(folder.path()).unwrap();
        let path = |name: &str| folder.path().join(name);
        for file in ["host-sim.bash", "_host-sim", "host-sim.fish", "_host-sim.ps1"] {
            let script = std::fs::read_to_string(path("completions").join(file)).unwrap();
            assert!(script.contains("replay") && script.contains("params-for"), "{file}");
        }
        let complete = ". \"$0\"; COMP_WORDS=(lab rep) COMP_CWORD=1; _lab lab rep lab; echo \"${COMPREPLY[@]}\"";
        let offered = Command::new("bash").args(["-c", complete]).arg(path("completions/lab.bash")).output().unwrap();
        assert_eq!(String::from_utf8(offered.stdout).unwrap(), "replay\n");
        for page in ["host-sim", "host-sim-fly", "host-sim-replay", "lab", "lab-serve", "lab-bench-accuracy"] {
            let text = std::fs::read_to_string(path("man/man1").join(format!("{page}.1"))).unwrap();
            assert!(text.contains(".SH SYNOPSIS"), "{page}: {text}");
        }
    }
}
