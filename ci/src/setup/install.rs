//! Installs Mesa's software drivers, a browser, validators of translations and Node, with the distribution's own
//! package manager.

use std::process::Command;

use anyhow::{Context, Result, bail};

use super::host::Host;
use crate::command;

/// The groups of packages that `cargo ci setup` can install.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Mesa's software drivers, for the execution paths.
    Drivers,
    /// Chromium, for the tests of the review page.
    Browser,
    /// The programs that check and compile naga's translations.
    Validators,
    /// Node and npm. On Debian, this group contains only pip, and pip then installs Node and npm.
    Node,
}

/// A group of distributions that share a package manager.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Family {
    Debian,
    Fedora,
    Arch,
    /// The name of an unsupported distribution.
    Other(String),
}

impl Family {
    /// Returns the family of the machine's distribution.
    pub(crate) fn of(host: &Host) -> Self {
        let places = ["/etc/os-release", "/usr/lib/os-release"];
        let read = |place| std::fs::read_to_string(host.path(place)).ok();
        let text = places.into_iter().find_map(read).unwrap_or_default();
        Self::from_os_release(&text)
    }

    /// Finds the family in the text of `os-release`. There `ID` names the distribution, and `ID_LIKE` lists its
    /// ancestors, the closest ancestor first.
    fn from_os_release(text: &str) -> Self {
        let value = |key: &str| {
            let mut lines = text.lines().filter_map(|line| line.trim().split_once('='));
            let (_, value) = lines.find(|(name, _)| *name == key)?;
            Some(value.trim_matches(['"', '\'']).to_owned())
        };
        let own = value("ID").unwrap_or_default();
        let like = value("ID_LIKE").unwrap_or_default();
        for name in std::iter::once(own.as_str()).chain(like.split_whitespace()) {
            match name {
                "debian" | "ubuntu" => return Self::Debian,
                "fedora" | "rhel" | "centos" => return Self::Fedora,
                "arch" => return Self::Arch,
                _ => {}
            }
        }
        Self::Other(if own.is_empty() { std::env::consts::OS.to_owned() } else { own })
    }

    /// Returns the commands that install the wanted packages, in the order in which they must run.
    fn commands(&self, wanted: Wanted) -> Vec<Package> {
        let fatal = |line: String| Package { failing: Failing::Fatal, line };
        let install = |manager: &str| fatal(format!("{manager} {}", self.packages(wanted)));
        match self {
            Self::Debian => vec![
                // A broken package list may not matter, so an error of `update` is tolerated. The installation decides.
                Package { failing: Failing::Tolerated, line: format!("{APT} update") },
                install(&format!("{APT} install -y --no-install-recommends")),
            ],
            Self::Fedora => vec![install("dnf install -y")],
            Self::Arch => vec![install("pacman -Sy --noconfirm --needed")],
            Self::Other(_) => Vec::new(),
        }
    }

    /// Returns the names of the wanted packages in this family of distributions.
    fn packages(&self, wanted: Wanted) -> &'static str {
        match (self, wanted) {
            (Self::Other(_), _) => "",
            (Self::Debian, Wanted::Drivers) => {
                "mesa-vulkan-drivers libvulkan1 libegl1 libgl1-mesa-dri"
            }
            (Self::Fedora, Wanted::Drivers) => {
                "mesa-vulkan-drivers vulkan-loader mesa-libEGL mesa-dri-drivers"
            }
            (Self::Arch, Wanted::Drivers) => "vulkan-swrast vulkan-icd-loader mesa",
            // Ubuntu has no such package, because its Chromium is a snap. Its CI images have Chrome.
            (Self::Debian, Wanted::Browser) => "chromium fonts-liberation",
            (Self::Fedora | Self::Arch, Wanted::Browser) => "chromium",
            (Self::Debian, Wanted::Validators) => "spirv-tools glslang-tools spirv-cross lcov",
            (Self::Fedora | Self::Arch, Wanted::Validators) => {
                "spirv-tools glslang spirv-cross lcov"
            }
            // Debian's own Node is too old, and its npm needs 350 packages. pip installs Node and npm in one package.
            (Self::Debian, Wanted::Node) => "python3-pip",
            (Self::Fedora | Self::Arch, Wanted::Node) => "nodejs npm",
        }
    }
}

/// The package manager of Debian. With this option it waits up to two minutes for another package manager to finish.
const APT: &str = "apt-get -o DPkg::Lock::Timeout=120";

/// One run of a package manager.
struct Package {
    line: String,
    failing: Failing,
}

enum Failing {
    Fatal,
    Tolerated,
}

/// The way in which this process can run a package manager as root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Privilege {
    Root,
    Sudo,
    Lacking,
}

impl Privilege {
    /// Finds out how this process can become root.
    pub(crate) fn current() -> Self {
        let id = Command::new("id").arg("-u").output();
        if id.is_ok_and(|output| output.stdout.trim_ascii() == b"0") {
            Self::Root
        } else if command::succeeds(Command::new("sudo").arg("--version")) {
            Self::Sudo
        } else {
            Self::Lacking
        }
    }

    /// Returns a command that runs `line`, a command line of the package manager, with this privilege.
    fn command(self, line: &str) -> Command {
        let mut words = line.split_whitespace();
        // sudo drops most variables, so `env` sets this one.
        let quiet = "DEBIAN_FRONTEND=noninteractive";
        let mut command = match self {
            Self::Sudo => {
                let mut command = Command::new("sudo");
                command.args(["env", quiet]);
                command
            }
            Self::Root | Self::Lacking => {
                let mut command = Command::new(words.next().unwrap_or_default());
                command.env("DEBIAN_FRONTEND", "noninteractive");
                command
            }
        };
        command.args(words);
        command
    }
}

/// Installs the wanted packages, and shows the output of the package manager.
pub(crate) fn run(family: &Family, privilege: Privilege, wanted: Wanted) -> Result<()> {
    let commands = family.commands(wanted);
    if commands.is_empty() || privilege == Privilege::Lacking {
        bail!("{}", advice(family, wanted));
    }
    for Package { line, failing } in commands {
        let mut command = privilege.command(&line);
        eprintln!("running: {}", command::describe(&command));
        match (command::run(&mut command), failing) {
            (Ok(()), _) => {}
            (Err(error), Failing::Tolerated) => eprintln!("going on although {error:#}"),
            (Err(error), Failing::Fatal) => {
                return Err(error).context(match wanted {
                    Wanted::Drivers => "could not install Mesa's software drivers",
                    Wanted::Browser => "could not install Chromium",
                    Wanted::Validators => "could not install the validators of translations",
                    Wanted::Node => "could not install Node",
                });
            }
        }
    }
    Ok(())
}

/// Returns a message with the commands that install the wanted packages, for users who type them by hand.
pub(crate) fn advice(family: &Family, wanted: Wanted) -> String {
    if let Family::Other(name) = family {
        let what = match wanted {
            Wanted::Drivers => {
                "the Vulkan loader, Mesa's lavapipe (Vulkan), libEGL and Mesa's llvmpipe (GL)"
            }
            Wanted::Browser => "Chromium or Chrome (KARAT_BROWSER names its program)",
            Wanted::Validators => "spirv-tools, glslang and spirv-cross, or Vulkan's SDK",
            Wanted::Node => "Node 20 or newer with npm",
        };
        return format!(
            "setup can't install packages on `{name}`; install {what}, then run `cargo ci setup` \
             again"
        );
    }
    let lines: Vec<String> = family.commands(wanted).into_iter().map(|one| one.line).collect();
    format!("to install what is missing, run as root: {}", lines.join(" && "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distributions_are_known_by_their_own_name_or_an_ancestors() {
        let debian = "PRETTY_NAME=\"Debian GNU/Linux 12 (bookworm)\"\nID=debian\n";
        assert_eq!(Family::from_os_release(debian), Family::Debian);
        let mint = "ID=linuxmint\nID_LIKE=\"ubuntu debian\"\n";
        assert_eq!(Family::from_os_release(mint), Family::Debian);
        let rocky = "ID=\"rocky\"\nID_LIKE=\"rhel centos fedora\"\n";
        assert_eq!(Family::from_os_release(rocky), Family::Fedora);
        assert_eq!(Family::from_os_release("ID_LIKE='arch'\nID=manjaro"), Family::Arch);
        assert_eq!(Family::from_os_release("ID=alpine"), Family::Other("alpine".to_owned()));
        // `VERSION_ID` and a comment must not be mistaken for `ID`.
        let decoys = "VERSION_ID=debian\n# ID=arch\nID=nixos\n";
        assert_eq!(Family::from_os_release(decoys), Family::Other("nixos".to_owned()));
    }

    #[test]
    fn sudo_is_put_before_the_package_manager() {
        let line = "pacman -Sy mesa";
        assert_eq!(
            command::describe(&Privilege::Sudo.command(line)),
            "sudo env DEBIAN_FRONTEND=noninteractive pacman -Sy mesa"
        );
        assert_eq!(
            command::describe(&Privilege::Root.command(line)),
            "DEBIAN_FRONTEND=noninteractive pacman -Sy mesa"
        );
    }

    #[test]
    fn setup_without_root_or_a_known_distribution_prints_what_to_install() {
        let message = |family, privilege| {
            run(&family, privilege, Wanted::Drivers).expect_err("it can't").to_string()
        };
        assert_eq!(
            message(Family::Fedora, Privilege::Lacking),
            "to install what is missing, run as root: dnf install -y mesa-vulkan-drivers \
             vulkan-loader mesa-libEGL mesa-dri-drivers"
        );
        assert!(
            message(Family::Other("alpine".to_owned()), Privilege::Root)
                .starts_with("setup can't install packages on `alpine`; install the Vulkan loader")
        );
    }
}
