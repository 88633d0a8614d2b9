// Ribs under the finger, for an empty GameObject. Start `haptix serve` before the scene.
using Haptix;
using Haptix.Messages;
using UnityEngine;

public class TextureUnderFinger : MonoBehaviour
{
    const string Ribs = @"{""kind"": ""grating"", ""period_mm"": 2.0, ""low"": 0.6, ""high"": 0.9}";

    Session _session;

    async void Start()
    {
        _session = await Session.Connect("texture under finger");
        _session.On<Contact>(e => Debug.Log(e.Event + " " + e.Region));
        _session.On<Output>(e => Debug.Log("output " + e.State + ": " + e.Reason));
        await _session.Geometry(Screen.dpi / 25.4);
        await _session.Layout.Add(Material.Parse(Ribs), widthMm: 300, heightMm: 200, name: "ribs");
        await _session.Acquire();
        await _session.Arm();
    }

    void Update()
    {
        if (_session == null) return;
        _session.Pump();
        var touches = new TouchReport[Input.touchCount];
        for (int i = 0; i < touches.Length; i++)
        {
            UnityEngine.Touch touch = Input.GetTouch(i);
            var kind = touch.phase == TouchPhase.Began ? TouchKind.Down
                : touch.phase == TouchPhase.Ended || touch.phase == TouchPhase.Canceled ? TouchKind.Up
                : TouchKind.Move;
            touches[i] = new TouchReport
            {
                TimeS = Session.NowS, // Unity tells no time of a touch; the frame's is the nearest
                TouchId = touch.fingerId,
                Kind = kind,
                InPixels = true,
                X = touch.position.x,
                Y = Screen.height - touch.position.y, // Unity counts from below
            };
        }
        if (touches.Length > 0) _session.Touches(touches);
    }

    void OnDisable()
    {
        if (_session != null) _session.Dispose();
    }
}
