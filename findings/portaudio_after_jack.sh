#!/usr/bin/env bash
# PortAudio 19.6.0 (Debian 12, libportaudio2 19.6.0-1.2) on JACK 1.9.21, by sounddevice 0.5.6.
# Its output stream plays; then JACK's server ends. Seen:
# - the callback is never called again, and the stream's finished callback is not called; only
#   Pa_IsStreamActive turns to 0;
# - a server that is started again does not wake the stream, and is not seen.
# What ends the stream then waits for JACK's thread, ten minutes in pa_jack.c, and what ends the library fails
# an assertion there (seen, and not repeated here). So a program that is to go on after JACK came back needs a
# process of its own for PortAudio.
set -euo pipefail
T=$(mktemp -d); trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$T"' EXIT
cd "$T"
apt-get -q download jackd2=1.9.21~dfsg-3 libjack-jackd2-0=1.9.21~dfsg-3 libportaudio2=19.6.0-1.2 \
  libasound2 libdb5.3 libopus0 libsamplerate0 libsndfile1 libflac12 libvorbis0a libvorbisenc2 libogg0 \
  libmpg123-0 libmp3lame0 libzita-alsa-pcmi0 libzita-resampler1 libdbus-1-3 libexpat1 > /dev/null
for deb in *.deb; do dpkg -x "$deb" root; done
python3 -m venv venv && venv/bin/pip -q install sounddevice==0.5.6 cffi==2.0.0
L=$T/root/usr/lib/$(uname -m)-linux-gnu
export LD_LIBRARY_PATH=$L:$T/root/lib/$(uname -m)-linux-gnu JACK_DRIVER_DIR=$L/jack JACK_NO_AUDIO_RESERVATION=1
export JACK_DEFAULT_SERVER=finding$$ L T
cat > program.py <<'P'
import ctypes.util, os, subprocess, time
ctypes.util.find_library = lambda name: os.environ["L"] + "/libportaudio.so.2"
command = [os.environ["T"] + "/root/usr/bin/jackd", "-r", "-n", os.environ["JACK_DEFAULT_SERVER"]]
command += ["-d", "dummy", "-r", "48000", "-p", "256", "-C", "0", "-P", "2"]
def serve():
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(2)
    return server
server = serve()
import sounddevice as sd  # initialises PortAudio
print(sd.get_portaudio_version()[1])
calls, finished = [0], []
def callback(out, frames, times, status):
    calls[0] += 1; out[:] = bytes(len(out))
stream = sd.RawOutputStream(48000, device="system", channels=1, dtype="float32", callback=callback,
                            finished_callback=lambda: finished.append(1))
stream.start(); time.sleep(0.5)
before = calls[0]
server.terminate(); server.wait(); time.sleep(0.3); stood = calls[0]; time.sleep(1.0)
print("called before:", before > 50, "after:", calls[0] - stood, "finished:", len(finished), "active:", stream.active)
server = serve(); stood = calls[0]; time.sleep(1.0)
print("called with a new server:", calls[0] - stood, flush=True)
server.kill(); server.wait()
os._exit(0)
P
seen=$(venv/bin/python program.py 2>/dev/null); echo "$seen"
grep -q "PortAudio V19.6.0" <<< "$seen"
grep -q "called before: True after: 0 finished: 0 active: False" <<< "$seen"
grep -q "called with a new server: 0" <<< "$seen"
