// All texts of the page: English, German, Italian. Another language is one more column.

import { remembered } from "./dom.js";

const LANGUAGES = ["en", "de", "it"];

const TEXTS = {
  stop: ["STOP", "STOPP", "STOP"],
  stop_help: ["Stop the robot at once (Escape)", "Den Roboter sofort anhalten (Escape)", "Ferma subito il robot (Esc)"],
  reset_stop: ["Let it move again", "Wieder fahren lassen", "Lascialo ripartire"],
  stop_executed: ["Stopped. The robot stays still until somebody lets it move again.", "Angehalten. Der Roboter bleibt stehen, bis ihn jemand wieder fahren lässt.", "Fermo. Il robot non si muove finché qualcuno non lo lascia ripartire."],
  stop_executed_short: ["stopped", "steht", "fermo"],
  stop_sending: ["STOP: sending…", "STOPP: wird gesendet …", "STOP: invio…"],
  stop_sending_short: ["sending…", "sende …", "invio…"],
  stop_acknowledged: ["Stopped (the robot does not confirm). It stays still until somebody lets it move again.", "Angehalten (der Roboter bestätigt nicht). Er bleibt stehen, bis ihn jemand wieder fahren lässt.", "Fermo (il robot non conferma). Non si muove finché qualcuno non lo lascia ripartire."],
  stop_acknowledged_short: ["stopped (not confirmed)", "steht (unbestätigt)", "fermo (non confermato)"],
  stop_out_of_reach: ["NOT STOPPED: the robot is out of reach, trying… Switch it off by hand if it drives.", "NICHT ANGEHALTEN: Der Roboter ist außer Reichweite, versuche weiter … Schalte ihn von Hand aus, wenn er fährt.", "NON FERMATO: il robot è fuori portata, riprovo… Spegnilo a mano, se si muove."],
  stop_out_of_reach_short: ["NOT STOPPED", "STEHT NICHT", "NON FERMATO"],
  stop_no_connection: ["NOT STOPPED: no connection to the robot's computer. Switch the robot off by hand, or go to it.", "NICHT ANGEHALTEN: keine Verbindung zum Computer des Roboters. Schalte den Roboter von Hand aus, oder geh zu ihm.", "NON FERMATO: nessun collegamento al computer del robot. Spegni il robot a mano, o raggiungilo."],
  stop_no_connection_short: ["NOT STOPPED", "STEHT NICHT", "NON FERMATO"],
  stop_give_up: ["Give up", "Aufgeben", "Rinuncia"],
  emergency_stop_low: ["The battery is low: while it is stopped, the robot does not go home.", "Der Akku ist schwach: Solange er angehalten ist, fährt der Roboter nicht heim.", "La batteria è scarica: da fermo non torna alla base."],

  connecting: ["Connecting to the robot", "Verbinde mit dem Roboter", "Mi collego al robot"],
  released: ["Disconnected, free for others", "Getrennt, frei für andere", "Scollegato, libero per altri"],
  lost: ["Connection lost, reconnecting", "Verbindung verloren, verbinde neu", "Collegamento perso, riprovo"],
  server_lost: ["The program does not answer. Is it still running?", "Das Programm antwortet nicht. Läuft es noch?", "Il programma non risponde. È ancora in funzione?"],
  evicted: ["Too many pages are open: this one made room for another. It tries again.", "Zu viele Seiten sind offen: diese hat einer anderen Platz gemacht. Sie versucht es wieder.", "Troppe pagine aperte: questa ha lasciato il posto a un'altra. Riprova."],
  no_connection: ["No connection for {seconds} s", "Keine Verbindung seit {seconds} s", "Nessun collegamento da {seconds} s"],
  offline: ["Not connected", "Nicht verbunden", "Non collegato"],
  free: ["Free to move", "Fahrbereit", "Libero di muoversi"],
  docked: ["On its station", "Auf der Station", "Sulla base"],
  docking: ["Looking for its station", "Sucht seine Station", "Cerca la base"],
  going_home: ["Battery low, going home", "Akku schwach, fährt heim", "Batteria scarica, torna alla base"],
  alarm: ["Battery low, ALARM: it needs help", "Akku schwach, ALARM: er braucht Hilfe", "Batteria scarica, ALLARME: serve aiuto"],
  driving_you: ["You are driving", "Du fährst", "Stai guidando tu"],
  driving: ["{name} is driving", "{name} fährt", "Guida {name}"],
  dock_state_charging: ["on its station, charging", "auf der Station, lädt", "sulla base, in carica"],
  dock_state_contact: ["on its station, not charging", "auf der Station, lädt nicht", "sulla base, non in carica"],
  dock_state_off: ["off its station", "unterwegs", "lontano dalla base"],
  dock_state_unknown: ["place unknown", "Ort unbekannt", "posizione ignota"],
  simulated: ["simulated", "simuliert", "simulato"],
  viewers: ["{count} watching", "{count} sehen zu", "{count} a guardare"],

  camera: ["Camera", "Kamera", "Telecamera"],
  camera_alt: ["What the robot's camera sees", "Was die Kamera des Roboters sieht", "Quello che vede la telecamera del robot"],
  camera_on: ["Picture", "Bild", "Immagine"],
  camera_wait: ["Waiting for a picture", "Warte auf ein Bild", "Aspetto un'immagine"],
  camera_age: ["This picture is {seconds} s old", "Dieses Bild ist {seconds} s alt", "Questa immagine ha {seconds} s"],
  camera_off: ["The camera is off", "Die Kamera ist aus", "La telecamera è spenta"],
  camera_never: ["The config keeps the camera off", "Die Konfiguration lässt die Kamera aus", "La configurazione tiene spenta la telecamera"],
  found: ["Mark what scripts find", "Funde der Skripte", "Cosa trovano gli script"],
  enlarge: ["Larger", "Größer", "Più grande"],
  delays: ["Commands wait {robot} in the robot; {network} through the network and back", "Befehle warten {robot} im Roboter; {network} durchs Netz und zurück", "I comandi attendono {robot} nel robot; {network} in rete, andata e ritorno"],
  fps: ["{fps} pictures per second", "{fps} Bilder pro Sekunde", "{fps} immagini al secondo"],

  skip: ["Skip to driving", "Zum Fahren springen", "Vai alla guida"],
  drive: ["Drive", "Fahren", "Guida"],
  drive_take: ["Take control", "Ans Steuer", "Prendi il volante"],
  drive_release: ["Release control", "Steuer abgeben", "Lascia il volante"],
  drive_hint: ["Arrow keys or W A S D, the pad, or a gamepad. The robot stops when you let go.", "Pfeiltasten oder W A S D, das Feld oder ein Gamepad. Loslassen hält an.", "Frecce o W A S D, il riquadro o un gamepad. Lasciando si ferma."],
  drive_taken: ["{name} is in control", "{name} ist am Steuer", "Il volante è di {name}"],
  drive_stopped: ["The robot is stopped: let it move again first", "Angehalten: erst wieder fahren lassen", "È fermo: prima lascialo ripartire"],
  drive_not_real_time: ["You can drive by hand only at speed 1x, and not while the simulation is paused", "Von Hand fahren geht nur mit Tempo 1x und nicht in der Pause", "Si guida a mano a velocità 1x, e non in pausa"],
  drive_docked: ["It is on its station. Leave it?", "Er steht auf der Station. Verlassen?", "È sulla base. Lasciarla?"],
  drive_lost: ["You are no longer in control", "Du bist nicht mehr am Steuer", "Non hai più il volante"],
  pad: ["Drive pad: hold and move", "Fahrfeld: halten und ziehen", "Riquadro di guida: tieni premuto e muovi"],
  forward: ["Forward", "Vorwärts", "Avanti"],
  backward: ["Backward", "Rückwärts", "Indietro"],
  left: ["Left", "Links", "Sinistra"],
  right: ["Right", "Rechts", "Destra"],
  power: ["Power", "Leistung", "Potenza"],
  dock: ["Go to the station", "Zur Station", "Vai alla base"],
  undock: ["Leave the station", "Station verlassen", "Lascia la base"],
  dock_done: ["It is on its station", "Er ist auf der Station", "È sulla base"],
  undock_done: ["It has left its station", "Er hat die Station verlassen", "Ha lasciato la base"],
  failed: ["It failed: {text}", "Fehlgeschlagen: {text}", "Non riuscito: {text}"],
  viewer_only: ["You can look and stop the robot, but nothing else", "Du darfst zusehen und anhalten, sonst nichts", "Puoi guardare e fermare il robot, nient'altro"],
  nonsense: ["The page and the program do not understand each other: reload the page", "Seite und Programm verstehen sich nicht: Seite neu laden", "La pagina e il programma non si capiscono: ricarica la pagina"],

  battery: ["Battery", "Akku", "Batteria"],
  charging: ["charging", "lädt", "in carica"],
  minutes_left: ["about {minutes} minutes left", "noch etwa {minutes} Minuten", "ancora circa {minutes} minuti"],
  seconds_ago: ["{seconds} s ago", "vor {seconds} s", "{seconds} s fa"],
  minutes_ago: ["{minutes} min ago", "vor {minutes} min", "{minutes} min fa"],
  minute_left: ["about 1 minute left", "noch etwa 1 Minute", "ancora circa 1 minuto"],
  charging_unknown: ["charging, level unknown", "lädt, Stand unbekannt", "in carica, livello ignoto"],
  level_unknown: ["level unknown", "Stand unbekannt", "livello ignoto"],
  battery_unknown: ["not known yet", "noch unbekannt", "non ancora nota"],
  battery_plot: ["Battery level over the last {minutes} minutes, now {percent} percent", "Akkustand der letzten {minutes} Minuten, jetzt {percent} Prozent", "Livello della batteria negli ultimi {minutes} minuti, ora {percent} per cento"],

  robot: ["Robot", "Roboter", "Robot"],
  robot_alt: ["The robot from above: {lights}; tracks {left} and {right} percent", "Der Roboter von oben: {lights}; Ketten {left} und {right} Prozent", "Il robot dall'alto: {lights}; cingoli {left} e {right} per cento"],
  lights_none: ["no light on", "kein Licht an", "nessuna luce accesa"],
  light_flash: ["Headlight", "Scheinwerfer", "Faro"],
  light_left: ["Left light", "Linkes Licht", "Luce sinistra"],
  light_right: ["Right light", "Rechtes Licht", "Luce destra"],
  tracks: ["Tracks", "Ketten", "Cingoli"],
  sound: ["Sound", "Klang", "Suono"],
  play: ["Play", "Abspielen", "Riproduci"],
  volume: ["Volume", "Lautstärke", "Volume"],

  behaviours: ["Behaviours", "Verhalten", "Comportamenti"],
  no_behaviours: ["No behaviour is known to this run.", "Dieser Lauf kennt kein Verhalten.", "Questa esecuzione non conosce comportamenti."],
  state_idle: ["not running", "läuft nicht", "fermo"],
  state_loading: ["loading", "wird geladen", "in caricamento"],
  state_running: ["running", "läuft", "in funzione"],
  state_ending: ["ending", "endet", "in chiusura"],
  start: ["Start", "Starten", "Avvia"],
  end: ["End", "Beenden", "Termina"],
  restart: ["Restart", "Neu starten", "Riavvia"],
  of: ["{action} {name}", "{name}: {action}", "{action} {name}"],
  ended: ["Last ended: {reason}", "Zuletzt beendet: {reason}", "Ultima fine: {reason}"],
  parameters: ["Parameters", "Parameter", "Parametri"],
  priority: ["priority {number}", "Priorität {number}", "priorità {number}"],
  show_script: ["Script", "Skript", "Script"],
  show_line: ["Show line {line} of {name}", "Zeile {line} von {name} zeigen", "Mostra la riga {line} di {name}"],
  previous: ["Previous", "Zurück", "Precedente"],
  next: ["Next", "Weiter", "Successiva"],
  gallery: ["Pictures", "Bilder", "Immagini"],
  today: ["Today", "Heute", "Oggi"],
  yesterday: ["Yesterday", "Gestern", "Ieri"],
  all_pictures: ["All {count} pictures", "Alle {count} Bilder", "Tutte le {count} immagini"],
  no_pictures: ["No pictures on this day.", "Keine Bilder an diesem Tag.", "Nessuna immagine in questo giorno."],
  close: ["Close", "Schließen", "Chiudi"],
  script_changed: ["The file has changed since the behaviour started: its lines may have moved.", "Die Datei hat sich seit dem Start geändert: Zeilen können sich verschoben haben.", "Il file è cambiato dopo l'avvio: le righe possono essere altrove."],
  script_gone: ["The script cannot be read", "Das Skript ist nicht lesbar", "Lo script non si può leggere"],

  log: ["Log", "Protokoll", "Registro"],
  level: ["Level", "Stufe", "Livello"],
  level_error: ["errors", "Fehler", "errori"],
  level_warn: ["warnings and errors", "Warnungen und Fehler", "avvisi ed errori"],
  level_info: ["info, warnings, errors", "Meldungen, Warnungen, Fehler", "informazioni, avvisi, errori"],
  level_debug: ["all", "alles", "tutto"],
  behaviour: ["Behaviour", "Verhalten", "Comportamento"],
  all: ["all", "alle", "tutti"],
  log_missed: ["{count} lines were not shown: too many at once", "{count} Zeilen fehlen: zu viele auf einmal", "{count} righe mancano: troppe insieme"],
  log_empty: ["Nothing yet.", "Noch nichts.", "Ancora niente."],

  history: ["History", "Verlauf", "Cronologia"],
  history_of: ["Show", "Zeige", "Mostra"],
  range_day: ["Day", "Tag", "Giorno"],
  range_week: ["Week", "Woche", "Settimana"],
  range_year: ["Year", "Jahr", "Anno"],
  hours: ["{hours} h", "{hours} h", "{hours} h"],
  lane_charging: ["Charging", "Laden", "In carica"],
  lane_runs: ["Runs", "Läufe", "Esecuzioni"],
  lane_docks: ["Dockings", "Andocken", "Rientri"],
  lane_alarms: ["Alarms", "Alarme", "Allarmi"],
  docks_failed: ["{docks}, {failed} failed", "{docks}, {failed} misslungen", "{docks}, {failed} falliti"],
  picture_of: ["Picture by {name}, {when}", "Bild von {name}, {when}", "Immagine di {name}, {when}"],
  event_dock: ["docking", "Andocken", "rientro"],
  event_undock: ["leaving the station", "Abdocken", "uscita dalla base"],
  event_safety: ["watchdog", "Wächter", "sorveglianza"],
  event_given_up: ["given up", "aufgegeben", "abbandonato"],
  event_start_missed: ["start missed", "Start versäumt", "avvio mancato"],
  event_standstill: ["stands", "steht", "fermo"],
  event_timetable_changed: ["timetable", "Zeitplan", "programma"],
  event_started: ["started", "gestartet", "avviato"],
  event_ended: ["ended", "beendet", "terminato"],
  event_notify: ["message", "Nachricht", "messaggio"],
  event_lost: ["not recorded", "nicht notiert", "non registrato"],
  code_done: ["done", "fertig", "fatto"],
  code_alarm: ["ALARM", "ALARM", "ALLARME"],
  schedule: ["Timetable", "Zeitplan", "Programma"],
  until: ["until {time}", "bis {time}", "fino a {time}"],
  start_quiet: ["quiet hours", "Ruhezeit", "ore di silenzio"],
  start_overlap: ["will not start: it still runs then", "startet nicht: läuft dann noch", "non parte: sarà ancora in funzione"],
  start_skipped: ["will not start: left out", "startet nicht: ausgelassen", "non parte: saltato"],
  leave_out: ["Leave out the next start", "Nächsten Start auslassen", "Salta il prossimo avvio"],
  keep_start: ["Do not leave out the next start", "Nächsten Start doch nicht auslassen", "Non saltare il prossimo avvio"],
  pause_until: ["Pause until", "Pausieren bis", "Sospendi fino a"],
  paused_until: ["Nothing starts until {time}.", "Bis {time} startet nichts.", "Non parte niente fino a {time}."],
  resume: ["End the pause", "Pause beenden", "Termina la pausa"],
  start_unknown: ["no such behaviour", "kein solches Verhalten", "comportamento inesistente"],

  map: ["Map", "Karte", "Mappa"],
  map_alt: ["Map of {name}: the robot is at {x}, {y} metres, {collisions} collisions so far", "Karte von {name}: Roboter bei {x}, {y} Metern, bisher {collisions} Zusammenstöße", "Mappa di {name}: il robot è a {x}, {y} metri, {collisions} urti finora"],
  map_hint: ["Drag the robot or a ball. The pale cone is the range of the station's infrared beacon: within it the robot's own search finds the station.", "Roboter oder Ball ziehen. Der blasse Kegel ist die Reichweite des Infrarot-Leuchtfeuers der Station: Dort findet der Roboter sie selbst.", "Trascina il robot o una palla. Il cono chiaro è la portata del faro infrarosso della base: lì la ricerca del robot la trova."],
  simulation: ["Simulation", "Simulation", "Simulazione"],
  sim_time: ["Simulated time", "Simulierte Zeit", "Tempo simulato"],
  sim_pause: ["Pause", "Pause", "Pausa"],
  sim_go_on: ["Resume", "Weiter", "Continua"],
  sim_step: ["One step", "Ein Schritt", "Un passo"],
  sim_speed: ["Speed", "Tempo", "Velocità"],
  sim_no_clock: ["This simulation runs in real time. Start it with --fast --live to pause it, go in steps or speed it up.", "Diese Simulation läuft in Echtzeit. Mit --fast --live gestartet lässt sie sich anhalten, schrittweise und schneller abspielen.", "Questa simulazione va in tempo reale. Avviata con --fast --live si può mettere in pausa, avanzare a passi e accelerare."],
  sim_battery: ["Battery level", "Akkustand", "Livello batteria"],
  sim_light: ["Light", "Licht", "Luce"],
  sim_noise: ["Make a noise", "Ein Geräusch machen", "Fai un rumore"],
  sim_hide: ["Station cannot be found", "Station nicht zu finden", "Base introvabile"],
  sim_charger: ["Station has no current", "Station ohne Strom", "Base senza corrente"],
  sim_fault: ["Fault", "Störung", "Guasto"],
  sim_begin: ["Begin", "Beginnen", "Inizia"],
  sim_clear: ["End all faults", "Alle Störungen beenden", "Fine di tutti i guasti"],
  sim_place: ["Put the robot", "Roboter setzen", "Metti il robot"],
  sim_place_ball: ["Put ball {number}", "Ball {number} setzen", "Metti la palla {number}"],
  sim_what: ["What", "Was", "Cosa"],
  sim_put: ["Put there", "Dorthin setzen", "Metti lì"],
  degrees: ["Heading, degrees", "Richtung, Grad", "Direzione, gradi"],
  metres_x: ["x, metres", "x, Meter", "x, metri"],
  metres_y: ["y, metres", "y, Meter", "y, metri"],

  fault_delay: ["slow network", "langsames Netz", "rete lenta"],
  fault_drop: ["connection closed", "Verbindung geschlossen", "connessione chiusa"],
  fault_half_open: ["connection silently dead", "Verbindung unbemerkt tot", "connessione muta"],
  fault_reboot: ["robot reboots", "Roboter startet neu", "il robot si riavvia"],
  fault_take_over: ["somebody else takes the robot", "jemand anderes nimmt den Roboter", "qualcun altro prende il robot"],
  fault_truncated_frames: ["truncated pictures", "abgeschnittene Bilder", "immagini troncate"],
  fault_flipped_frames: ["damaged pictures", "beschädigte Bilder", "immagini rovinate"],
  fault_no_power: ["no battery reports", "keine Akkumeldungen", "nessun dato della batteria"],
  fault_power_jumps: ["wrong battery levels", "Akkustand springt", "livello che salta"],
  fault_dock_lost: ["slides off its station", "rutscht von der Station", "scivola via dalla base"],

  login: ["Log in", "Anmelden", "Accedi"],
  book: ["Book", "Handbuch", "Manuale"],
  logout: ["Log out", "Abmelden", "Esci"],
  token: ["Token", "Token", "Token"],
  login_hint: ["Open the link that “spykee token new” has printed, or scan its QR code. Ask the person who runs the robot.", "Öffne den Link, den „spykee token new“ ausgegeben hat, oder scanne seinen QR-Code. Frage die Person, die den Roboter betreibt.", "Apri il link stampato da “spykee token new”, o scansiona il suo codice QR. Chiedi a chi gestisce il robot."],
  name: ["Your name", "Dein Name", "Il tuo nome"],
  language: ["Language", "Sprache", "Lingua"],
  theme: ["Colours", "Farben", "Colori"],
  theme_auto: ["like the system", "wie das System", "come il sistema"],
  theme_light: ["light", "hell", "chiari"],
  theme_dark: ["dark", "dunkel", "scuri"],
  role_viewer: ["You may look", "Du darfst zusehen", "Puoi guardare"],
  running: ["running for {time}", "läuft seit {time}", "in funzione da {time}"],
};

/** Returns the column of the chosen language, or else of the browser's. */
function column() {
  const wanted = [remembered("language", ""), ...navigator.languages];
  for (const language of wanted) {
    const found = LANGUAGES.indexOf(language.slice(0, 2).toLowerCase());
    if (found >= 0) {
      return found;
    }
  }
  return 0;
}

const COLUMN = column();
document.documentElement.lang = LANGUAGES[COLUMN];

/** The current language. */
export const language = LANGUAGES[COLUMN];

/** The languages with their native names. */
export const languages = [["en", "English"], ["de", "Deutsch"], ["it", "Italiano"]];

/** Adds the texts of another page. */
export function addTexts(more) {
  Object.assign(TEXTS, more);
}

/** Returns the text of a key with `{name}` replaced; the key itself if it has no text. */
export function t(key, values = {}) {
  const text = TEXTS[key]?.[COLUMN] ?? key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => String(values[name] ?? whole));
}
