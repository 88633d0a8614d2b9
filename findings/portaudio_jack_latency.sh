#!/usr/bin/env bash
# PortAudio 19.6.0 (Debian 12, libportaudio2 19.6.0-1.2) on JACK 1.9.21 in synchronous mode, by sounddevice 0.5.6.
# The latency that an output stream states is one period less than that of JACK's port: 0.0 s here, and one
# period in asynchronous mode, where it is two. The times of the callback have the port's own value:
# outputBufferDacTime - currentTime. (PortAudio's commit 3ee53a79 mends the first; 19.7.0 is before it, and
# the version's number has not changed since, so that it does not tell which value is meant.)
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
export JACK_DEFAULT_SERVER=finding$$ L
cat > program.py <<'P'
import ctypes.util, os, time
ctypes.util.find_library = lambda name: os.environ["L"] + "/libportaudio.so.2"
import sounddevice as sd
leads = []
def callback(out, frames, times, status):
    leads.append((frames, times.outputBufferDacTime - times.currentTime)); out[:] = bytes(len(out))
stream = sd.RawOutputStream(48000, device="system", channels=1, dtype="float32", callback=callback)
stream.start(); time.sleep(0.5)
frames, lead_s = leads[-1]
print(f"{sd.get_portaudio_version()[1]}: block {frames}, stated {stream.latency * 48000:.0f}, to the output {lead_s * 48000:.0f} samples")
stream.close()
P
for mode in -S ""; do
  root/usr/bin/jackd -r $mode -n $JACK_DEFAULT_SERVER -d dummy -r 48000 -p 256 -C 0 -P 2 > /dev/null 2>&1 & server=$!
  sleep 2
  seen=$(venv/bin/python program.py 2>/dev/null); echo "${mode:-asynchronous} $seen"
  kill $server; wait $server 2>/dev/null || true
  if [ -n "$mode" ]; then grep -q "block 256, stated 0, to the output 256 samples" <<< "$seen"
  else grep -q "block 256, stated 256, to the output 512 samples" <<< "$seen"; fi
done
