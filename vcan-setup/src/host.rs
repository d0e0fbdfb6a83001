//! What kind of machine this is, and the commands that mend it.
//!
//! The same lack has another remedy on another distribution, in a container and under WSL, so a
//! list of remedies begins with the one for here.

use std::fmt;
use std::fs;
use std::path::Path;

/// What may be lacking, as far as the remedy depends on the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// CAN in the kernel, or its `vcan` driver.
    Can,
    /// The right to administer the network.
    NetAdmin,
    /// A real-time kernel.
    PreemptRt,
    /// A kernel to boot for those who have none with CAN.
    UserModeLinux,
}

/// Where a remedy works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// In a container, whatever is inside.
    Container,
    /// Under Windows.
    Wsl,
    /// Debian and what calls itself like it.
    Debian,
    /// Ubuntu and what calls itself like it.
    Ubuntu,
    /// Fedora and what calls itself like it.
    Fedora,
    /// Arch Linux and what calls itself like it.
    Arch,
    /// Every Linux.
    Anywhere,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Container => "container",
            Self::Wsl => "WSL",
            Self::Debian => "Debian",
            Self::Ubuntu => "Ubuntu",
            Self::Fedora => "Fedora",
            Self::Arch => "Arch",
            Self::Anywhere => "anywhere",
        })
    }
}

/// A command that mends a lack, and where it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Remedy {
    /// Where it works.
    pub place: Place,
    /// What to type, or to do.
    pub command: &'static str,
}

/// The machine, as far as remedies depend on it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Host {
    /// What it is, the narrowest first.
    places: Vec<Place>,
    /// Its name in words, such as `Debian GNU/Linux 12 (bookworm)`.
    pub name: String,
}

impl Host {
    /// Looks at the machine this process runs on.
    #[must_use]
    pub fn detect() -> Self {
        let text = |path: &str| fs::read_to_string(path).unwrap_or_default();
        let markers = ["/.dockerenv", "/run/.containerenv", "/run/systemd/container"];
        let in_container = markers.iter().any(|path| Path::new(path).exists())
            || is_container(&text("/proc/1/cgroup"));
        Self::from_texts(&text("/etc/os-release"), &text("/proc/version"), in_container)
    }

    /// The machine of which these are `/etc/os-release` (os-release(5)) and `/proc/version`.
    fn from_texts(os_release: &str, version: &str, in_container: bool) -> Self {
        let value = |key: &str| {
            let line =
                os_release.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
            line.unwrap_or_default().trim_matches(['"', '\'']).to_owned()
        };
        let mut places = Vec::new();
        places.extend(in_container.then_some(Place::Container));
        places.extend(version.to_lowercase().contains("microsoft").then_some(Place::Wsl));
        let ids = format!("{} {}", value("ID"), value("ID_LIKE"));
        let of_id = |id| match id {
            "ubuntu" => Some(Place::Ubuntu),
            "debian" | "raspbian" => Some(Place::Debian),
            "fedora" | "rhel" | "centos" => Some(Place::Fedora),
            "arch" => Some(Place::Arch),
            _ => None,
        };
        places.extend(ids.split_whitespace().find_map(of_id));
        let name = Some(value("PRETTY_NAME")).filter(|name| !name.is_empty());
        let mut name = name.unwrap_or_else(|| "an unknown Linux".into());
        for (place, words) in [(Place::Container, ", container"), (Place::Wsl, ", WSL")] {
            name.push_str(if places.contains(&place) { words } else { "" });
        }
        Self { places, name }
    }

    /// The remedies for a lack: those for here first, the narrowest of them before the others.
    #[must_use]
    pub fn remedies(&self, lack: Lack) -> Vec<Remedy> {
        let mut remedies = table(lack).to_vec();
        let foreign = self.places.len();
        let rank = |remedy: &Remedy| match remedy.place {
            Place::Anywhere => foreign,
            place => self.places.iter().position(|here| *here == place).unwrap_or(foreign + 1),
        };
        remedies.sort_by_key(rank);
        remedies
    }

    /// The first remedy for a lack.
    #[must_use]
    pub fn remedy(&self, lack: Lack) -> &'static str {
        self.remedies(lack).first().map_or("", |remedy| remedy.command)
    }
}

/// Whether the cgroup of the first process is one that container engines make.
fn is_container(cgroup: &str) -> bool {
    ["docker", "kubepods", "containerd", "lxc", "libpod"].iter().any(|word| cgroup.contains(word))
}

/// The remedies for a lack, in the order of a reader who does not say where he is.
fn table(lack: Lack) -> &'static [Remedy] {
    match lack {
        Lack::Can => &CAN,
        Lack::NetAdmin => &NET_ADMIN,
        Lack::PreemptRt => &PREEMPT_RT,
        Lack::UserModeLinux => &USER_MODE_LINUX,
    }
}

const fn at(place: Place, command: &'static str) -> Remedy {
    Remedy { place, command }
}

const CAN: [Remedy; 7] = [
    at(
        Place::Debian,
        "sudo modprobe -a can can_raw vcan (a cloud kernel has none: sudo apt install \
         linux-image-amd64, and boot it)",
    ),
    at(
        Place::Ubuntu,
        "sudo apt install linux-modules-extra-$(uname -r) && sudo modprobe -a can can_raw vcan",
    ),
    at(
        Place::Fedora,
        "sudo dnf install kernel-modules-$(uname -r) kernel-modules-extra-$(uname -r) && \
         sudo modprobe -a can can_raw vcan",
    ),
    at(Place::Arch, "sudo modprobe -a can can_raw vcan (after an update of linux, reboot first)"),
    at(
        Place::Wsl,
        "sudo modprobe -a can_raw vcan; if this kernel has no such modules, one built with \
         CONFIG_CAN, CONFIG_CAN_RAW and CONFIG_CAN_VCAN, named in %UserProfile%\\.wslconfig",
    ),
    at(
        Place::Container,
        "on the host: sudo modprobe -a can can_raw vcan; and docker run --cap-add=NET_ADMIN",
    ),
    at(Place::Anywhere, "platoon vcan shell -- CMD (a kernel with CAN as an ordinary process)"),
];

const NET_ADMIN: [Remedy; 3] = [
    at(Place::Container, "docker run --cap-add=NET_ADMIN"),
    at(Place::Anywhere, "sudo \"$(command -v platoon)\" vcan up"),
    at(
        Place::Anywhere,
        "unshare --map-root-user --net sh -c 'platoon vcan up && CMD' (no root, a network of its \
         own)",
    ),
];

const PREEMPT_RT: [Remedy; 5] = [
    at(Place::Debian, "sudo apt install linux-image-rt-amd64, and boot it"),
    at(Place::Ubuntu, "sudo pro enable realtime-kernel, and reboot"),
    at(Place::Fedora, "sudo dnf install kernel-rt (RHEL, CentOS), and boot it"),
    at(Place::Arch, "sudo pacman -S linux-rt, and boot it"),
    at(Place::Anywhere, "a kernel built with CONFIG_PREEMPT_RT (in mainline from Linux 6.12 on)"),
];

const USER_MODE_LINUX: [Remedy; 3] = [
    at(Place::Debian, "sudo apt install user-mode-linux"),
    at(Place::Ubuntu, "sudo apt install user-mode-linux"),
    at(
        Place::Anywhere,
        "make ARCH=um in a kernel tree, with CONFIG_HOSTFS and CONFIG_CAN_VCAN; then --uml PATH",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn host(os_release: &str, version: &str, in_container: bool) -> Host {
        Host::from_texts(os_release, version, in_container)
    }

    const UBUNTU: &str = "PRETTY_NAME=\"Ubuntu 24.04\"\nID=ubuntu\nID_LIKE=debian\n";
    const STOCK: &str = "Linux version 6.8.0-31-generic (buildd@lcy02)";

    #[test]
    fn each_distribution_reads_its_own_command_first() {
        for (os_release, words) in [
            (UBUNTU, "linux-modules-extra"),
            ("ID=debian\n", "linux-image-amd64"),
            ("ID=\"rocky\"\nID_LIKE=\"rhel centos fedora\"\n", "dnf install"),
            ("ID=manjaro\nID_LIKE=arch\n", "after an update"),
            ("ID=linuxmint\nID_LIKE=\"ubuntu debian\"\n", "linux-modules-extra"),
            ("", "platoon vcan shell"),
        ] {
            let first = host(os_release, STOCK, false).remedy(Lack::Can);
            assert!(first.contains(words), "{os_release:?}: {first}");
        }
    }

    #[test]
    fn a_container_and_wsl_come_before_the_distribution_in_them() {
        let wsl = "Linux version 5.15.153.1-microsoft-standard-WSL2";
        assert!(host(UBUNTU, wsl, false).remedy(Lack::Can).contains(".wslconfig"));
        let both = host(UBUNTU, wsl, true);
        assert!(both.remedy(Lack::Can).contains("on the host"));
        assert_eq!(both.name, "Ubuntu 24.04, container, WSL");
    }

    #[test]
    fn the_remedies_for_elsewhere_follow_those_for_here_and_for_anywhere() {
        let remedies = host(UBUNTU, STOCK, false).remedies(Lack::Can);
        let places: Vec<Place> = remedies.iter().map(|remedy| remedy.place).collect();
        assert_eq!(places[..2], [Place::Ubuntu, Place::Anywhere]);
        assert_eq!(places.len(), CAN.len());
    }

    #[test]
    fn every_lack_has_a_remedy_everywhere() {
        for lack in [Lack::Can, Lack::NetAdmin, Lack::PreemptRt, Lack::UserModeLinux] {
            assert!(!host("", "", false).remedy(lack).is_empty());
        }
    }

    #[test]
    fn a_container_is_known_by_its_cgroup() {
        assert!(is_container("0::/system.slice/docker-3f2a.scope\n"));
        assert!(!is_container("0::/init.scope\n"));
    }
}
