//! Effects that a person adds: no search and no decision, the same fit and the same judgement.

use std::sync::Arc;

use super::super::DiagnosisError;
use super::super::fit::Fitted;
use super::{Accepted, Candidate, Outcome, Search};
use crate::effects::{Effect, Site, UnknownEffect};
use crate::robot::Robot;

/// An effect and where it acts.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct Wanted {
    pub effect: String,
    pub site: Site,
    /// As it was written.
    pub text: String,
}

impl Wanted {
    /// Of `torque_ripple@joint_2`, `payload_change` for the whole arm,
    /// `wrist_coupling@joint_6,joint_5` for a pair.
    pub fn parse(text: &str, robot: &Robot) -> Result<Self, DiagnosisError> {
        let wrong = |reason: String| DiagnosisError::Addition { addition: text.into(), reason };
        let (effect, joints) = text.split_once('@').unwrap_or((text, ""));
        let place = |name: &str| {
            let name = name.trim();
            robot.joint_index(name).ok_or_else(|| {
                let known: Vec<String> =
                    robot.joint_names().map(|own| format!("`{own}`")).collect();
                wrong(format!("there is no joint `{name}`; the joints are {}", known.join(", ")))
            })
        };
        let names: Vec<&str> = joints.split(',').filter(|name| !name.trim().is_empty()).collect();
        let site = match names[..] {
            [] => Site::Arm,
            [joint] => Site::Joint(place(joint)?),
            [joint, other] => Site::Pair(place(joint)?, place(other)?),
            _ => {
                return Err(wrong(
                    "an effect acts at the arm, at a joint, or at a joint and another one".into(),
                ));
            }
        };
        Ok(Self { effect: effect.trim().into(), site, text: text.into() })
    }

    /// Whether the effect is known and can act there.
    pub fn check(
        &self,
        catalogue: &[Arc<dyn Effect>],
        robot: &Robot,
    ) -> Result<(), DiagnosisError> {
        let wrong =
            |reason: String| DiagnosisError::Addition { addition: self.text.clone(), reason };
        let Some(effect) = catalogue.iter().find(|effect| effect.name() == self.effect) else {
            let known = catalogue.iter().map(|effect| effect.name().into()).collect();
            return Err(wrong(UnknownEffect::new(&self.effect, known).to_string()));
        };
        let sites = effect.sites(robot);
        if sites.contains(&self.site) {
            return Ok(());
        }
        Err(wrong(match sites.first() {
            Some(Site::Arm) => "it acts on the whole arm: give its name alone".into(),
            Some(Site::Joint(_)) => "it acts at a joint: give `effect@joint`".into(),
            Some(Site::Pair(..)) => {
                "it acts at a joint and is driven by another: give `effect@joint,other`".into()
            }
            None => "it acts nowhere on this robot".into(),
        }))
    }

    fn is(&self, candidate: &Candidate) -> bool {
        candidate.term.effect.name() == self.effect && candidate.term.site == self.site
    }
}

impl Search<'_> {
    /// The model with the wanted effects, each with its constants where they explain most, all
    /// parameters fitted together.
    pub fn by_hand(
        &mut self,
        start: &Fitted,
        wanted: &[Wanted],
    ) -> Result<Outcome, DiagnosisError> {
        let mut fitted = start.clone();
        let mut accepted: Vec<Accepted> = Vec::new();
        let mut ranking = Vec::new();
        for one in wanted {
            let (basis, white) = self.with_nuisances(&fitted);
            let candidates = self.rank(&fitted, &basis, &white)?;
            let Some(candidate) = candidates.iter().find(|candidate| one.is(candidate)) else {
                return Err(DiagnosisError::Addition {
                    addition: one.text.clone(),
                    reason: self.why_not(one),
                });
            };
            let refined = self.refine(&fitted, (&basis, &white), candidate);
            let next = self.polish(self.with_term(&fitted, refined.term.clone()));
            let errors = [&fitted, &next].map(|fit| self.errors(fit));
            let step = Accepted::new(
                &refined.term,
                refined.score,
                [&fitted, &next],
                (&errors[0], &errors[1]),
            );
            accepted.push(Accepted { wanted: true, ..step });
            fitted = next;
            if ranking.is_empty() {
                ranking = candidates;
                let standing = self.standing(start);
                self.judge_best(start, &standing, &mut ranking)?;
            }
        }
        let [held_out_before, held_out] = [start, &fitted].map(|fit| self.held_out(fit));
        Ok(Outcome { start: start.clone(), fitted, accepted, ranking, held_out_before, held_out })
    }

    /// Why an effect that can act there is not among the candidates.
    fn why_not(&self, wanted: &Wanted) -> String {
        let own = self.catalogue.iter().find(|effect| effect.name() == wanted.effect);
        if own.is_some_and(|effect| self.has_everywhere(effect.as_ref())) {
            return "the model has it at every joint".into();
        }
        "these logs cannot show it: the parameters of the model take up what it does, or its time \
         or channel is not logged"
            .into()
    }
}
