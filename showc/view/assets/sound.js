// Music in step with the show: a file that the page carries, or that is chosen.

const sound = { audio: null, peaks: null, rate: 20 };
// Further apart than this [s], the music is set anew; less is caught up by itself.
const DRIFT = 0.08;

function soundOffset() {
  return show.soundtrack?.offset ?? 0;
}

async function loadSound(bytes, kind) {
  sound.audio?.pause();
  const audio = new Audio(URL.createObjectURL(new Blob([bytes], { type: kind })));
  audio.preservesPitch = true;
  sound.audio = audio;
  document.documentElement.dataset.sound = "yes";
  try {
    const context = new OfflineAudioContext(1, 1, 22050);
    const decoded = await context.decodeAudioData(bytes.slice ? bytes.slice(0) : bytes);
    const samples = decoded.getChannelData(0);
    const size = Math.floor(decoded.sampleRate / sound.rate);
    const peaks = new Float32Array(Math.ceil(samples.length / size));
    for (let k = 0; k < samples.length; k++) {
      const at = Math.floor(k / size);
      const value = Math.abs(samples[k]);
      if (value > peaks[at]) peaks[at] = value;
    }
    sound.peaks = peaks;
  } catch {
    sound.peaks = null;
    sound.audio = null;
    document.documentElement.dataset.sound = "no";
    caption("This browser cannot play that file.");
  }
  timeline.draw();
  wake();
}

// The show leads: music is where the show is, or silent before and after itself.
function followSound() {
  const { audio } = sound;
  if (!audio) return;
  const time = player.time - soundOffset();
  const heard = player.playing && time >= 0 && time < (audio.duration || Infinity) && player.speed <= 4 && player.speed >= 0.25;
  if (!heard) {
    if (!audio.paused) audio.pause();
    return;
  }
  audio.playbackRate = player.speed;
  if (Math.abs(audio.currentTime - time) > DRIFT * Math.max(player.speed, 1)) audio.currentTime = time;
  if (audio.paused) audio.play().catch(() => {});
}

async function loadOwnSound() {
  const element = document.getElementById("recording");
  const text = element.textContent.trim();
  element.remove();
  if (text) await loadSound(decodeBase64(text).buffer, "");
}
