"""Two stimuli of a set, in PsychoPy's Coder: which was stronger?"""

from psychopy import core, event, visual
from psychopy_haptix.session import HapticStimulus, HaptixSession

window = visual.Window()
words = visual.TextStim(window, text="Slide your finger. First or second stronger? 1 or 2")
clock = core.Clock()
with HaptixSession("mock:pace=real") as session:
    for file, code in (("stimuli/weak.wav", 1), ("stimuli/strong.wav", 2)):
        words.draw()
        window.flip()
        stimulus = HapticStimulus(session)
        stimulus.load(file, code, clock.getTime)
        stimulus.play()
        while not stimulus.is_done:
            core.wait(0.01)
        print(file, stimulus.onset, stimulus.onset_by)
    print(event.waitKeys(keyList=["1", "2"], timeStamped=clock))
