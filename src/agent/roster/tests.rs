use tokio::time::sleep;

use super::*;

impl Roster {
    /// A roster without behaviours: for each start and stop the test gets its text and the channel
    /// for its outcome.
    pub(crate) fn fake(
        statuses: watch::Receiver<Vec<BehaviourStatus>>,
    ) -> (Roster, mpsc::UnboundedReceiver<(String, Reply)>) {
        let (roster, mut commands) = Roster::new(statuses, ViewerChannel::default());
        let (shown, taken) = mpsc::unbounded_channel();
        tokio::spawn(async move {
            while let Some(command) = commands.recv().await {
                let text = format!("{command:?}");
                let (RosterCommand::Start(_, _, reply) | RosterCommand::Stop(_, _, reply)) =
                    command
                else {
                    continue;
                };
                let _ = shown.send((text, reply));
            }
        });
        (roster, taken)
    }
}

#[tokio::test(start_paused = true)]
async fn a_patient_command_waits_for_its_outcome_longer_than_a_person_does() {
    let (roster, mut commands) = Roster::fake(watch::Sender::new(Vec::new()).subscribe());
    let slow = async {
        let (_, first) = commands.recv().await.unwrap();
        let (_, second) = commands.recv().await.unwrap();
        sleep(2 * ANSWER).await;
        for reply in [first, second] {
            let _ = reply.send(Ok(()));
        }
    };
    let patient = roster.without_timeout();
    let (hasty, patient, ()) = tokio::join!(roster.start("go"), patient.start("go"), slow);
    assert_eq!((hasty, patient), (Err(RosterError::Busy), Ok(())));
}
