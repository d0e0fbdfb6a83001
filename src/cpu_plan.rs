//! Which CPU each process of a run is kept on.

use std::fmt;
use std::str::FromStr;

/// A plan of CPUs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CpuPlan {
    /// The rig has the first CPU; ECUs take turns on the others, and with it when there are two.
    Auto,
    /// Wherever the kernel puts them.
    Any,
    /// As told.
    Given {
        /// The rig's CPU.
        rig: usize,
        /// The ECUs' CPUs, in turns.
        ecus: Vec<usize>,
    },
}

impl CpuPlan {
    /// The rig's CPU among those online.
    pub fn of_rig(&self, online: &[usize]) -> Option<usize> {
        match self {
            Self::Auto => online.first().copied(),
            Self::Any => None,
            Self::Given { rig, .. } => Some(*rig),
        }
    }

    /// The CPU of a truck's ECU.
    pub fn of_ecu(&self, online: &[usize], truck: u8) -> Option<usize> {
        let truck = usize::from(truck);
        match (self, online) {
            (Self::Given { ecus, .. }, _) => Some(ecus[truck % ecus.len()]),
            (Self::Any, _) | (Self::Auto, [] | [_]) => None,
            // The leader's ECU has least to do, so that the rig shares with the fewest of the rest.
            (Self::Auto, [first, second]) => Some([*second, *first][truck % 2]),
            (Self::Auto, [_, others @ ..]) => Some(others[truck % others.len()]),
        }
    }

    /// A CPU of the plan that is not online.
    pub fn missing(&self, online: &[usize]) -> Option<usize> {
        let Self::Given { rig, ecus } = self else { return None };
        std::iter::once(rig).chain(ecus).copied().find(|cpu| !online.contains(cpu))
    }
}

impl FromStr for CpuPlan {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const FORM: &str = "give auto, any, or RIG:ECU,ECU,... such as 0:1 or 0:1,0,1,0";
        match text {
            "auto" => return Ok(Self::Auto),
            "any" => return Ok(Self::Any),
            _ => (),
        }
        let (rig, ecus) = text.split_once(':').ok_or(FORM)?;
        let cpu = |word: &str| word.trim().parse::<usize>().map_err(|_| FORM.to_owned());
        let ecus = ecus.split(',').map(cpu).collect::<Result<Vec<usize>, String>>()?;
        Ok(Self::Given { rig: cpu(rig)?, ecus })
    }
}

impl fmt::Display for CpuPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Any => f.write_str("any"),
            Self::Given { rig, ecus } => {
                let ecus: Vec<String> = ecus.iter().map(usize::to_string).collect();
                write!(f, "{rig}:{}", ecus.join(","))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(plan: &str, online: &[usize]) -> (Option<usize>, Vec<Option<usize>>) {
        let plan: CpuPlan = plan.parse().expect("well formed");
        (plan.of_rig(online), (0..4).map(|truck| plan.of_ecu(online, truck)).collect())
    }

    #[test]
    fn two_cpus_are_shared_and_more_leave_the_rig_alone() {
        let (rig, ecus) = places("auto", &[0, 1]);
        assert_eq!((rig, ecus), (Some(0), [1, 0, 1, 0].map(Some).to_vec()));
        let (rig, ecus) = places("auto", &[2, 5, 7]);
        assert_eq!((rig, ecus), (Some(2), [5, 7, 5, 7].map(Some).to_vec()));
        assert_eq!(places("auto", &[0]), (Some(0), vec![None; 4]));
    }

    #[test]
    fn a_given_plan_is_followed_and_any_leaves_it_to_the_kernel() {
        assert_eq!(places("0:1", &[0, 1]), (Some(0), vec![Some(1); 4]));
        let (rig, ecus) = places("1:0,1,1", &[0, 1]);
        assert_eq!((rig, ecus), (Some(1), [0, 1, 1, 0].map(Some).to_vec()));
        assert_eq!(places("any", &[0, 1]), (None, vec![None; 4]));
    }

    #[test]
    fn cpus_that_are_not_there_are_noticed_and_nonsense_is_refused() {
        let plan: CpuPlan = "0:1,9".parse().expect("well formed");
        assert_eq!((plan.missing(&[0, 1]), plan.to_string().as_str()), (Some(9), "0:1,9"));
        for nonsense in ["", "0", ":", "0:", "a:1", "0:1,,2", "-1:0"] {
            assert!(nonsense.parse::<CpuPlan>().is_err(), "{nonsense}");
        }
    }
}
