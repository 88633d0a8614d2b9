// mono Player.exe legacy | new | mouse: plays scenes with the component against the service of HAPTIX_SERVICE, as Unity would.
using System;
using System.Collections.Concurrent;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;
using System.Threading;
using Haptix;
using UnityEngine;
using EnhancedTouch = UnityEngine.InputSystem.EnhancedTouch.Touch;
using NewPhase = UnityEngine.InputSystem.TouchPhase;

static class Player
{
    /// <summary>Unity's main thread: what was awaited goes on in a frame.</summary>
    sealed class MainThread : SynchronizationContext
    {
        readonly ConcurrentQueue<Action> _waiting = new ConcurrentQueue<Action>();

        public override void Post(SendOrPostCallback call, object state) { _waiting.Enqueue(() => call(state)); }

        public void Run()
        {
            Action each;
            while (_waiting.TryDequeue(out each)) each();
        }
    }

    const float PxPerMm = 4f;
    const int Patience = 6000; // frames
    static readonly MainThread Loop = new MainThread();
    static readonly List<LayoutUnderFinger> Enabled = new List<LayoutUnderFinger>();
    static readonly List<string> Heard = new List<string>();
    static string _input;
    static int _touchId = 1000; // of the new input system: another with each touch

    static void Call(object component, string method, params object[] arguments)
    {
        MethodInfo found = component.GetType().GetMethod(method, BindingFlags.NonPublic | BindingFlags.Instance);
        try { found.Invoke(component, arguments); }
        catch (TargetInvocationException error) { throw new Exception(method, error.InnerException); }
    }

    static void Frame()
    {
        Thread.Sleep(8);
        Loop.Run();
        foreach (LayoutUnderFinger each in Enabled.ToArray()) Call(each, "Update");
        if (Debug.Errors.Count > 0) throw new Exception(Debug.Errors[0]);
        Input.Touches.RemoveAll(touch => touch.phase == TouchPhase.Ended);
        EnhancedTouch.All.RemoveAll(touch => touch.phase == NewPhase.Ended);
        Input.IsReleased = false;
        if (UnityEngine.InputSystem.Mouse.current != null) UnityEngine.InputSystem.Mouse.current.leftButton.wasReleasedThisFrame = false;
    }

    static void Until(Func<bool> holds, string what)
    {
        for (int i = 0; i < Patience; i++, Frame()) if (holds()) return;
        throw new Exception("expected: " + what + "; heard " + string.Join(", ", Heard));
    }

    /// <summary>A finger, or the mouse, at a place from the upper left corner.</summary>
    static void Put(float xMm, float yMm, bool isDown)
    {
        var place = new Vector2 { x = xMm * PxPerMm, y = Screen.height - yMm * PxPerMm };
        bool began = Input.Touches.Count == 0 && EnhancedTouch.All.Count == 0;
        if (_input == "legacy")
        {
            Input.Touches.Clear();
            Input.Touches.Add(new Touch { fingerId = 3, position = place, phase = !isDown ? TouchPhase.Ended : began ? TouchPhase.Began : TouchPhase.Moved });
        }
        else if (_input == "new")
        {
            EnhancedTouch.All.Clear();
            EnhancedTouch.All.Add(new EnhancedTouch {
                finger = new UnityEngine.InputSystem.EnhancedTouch.Finger { index = 3 }, touchId = _touchId++, screenPosition = place,
                phase = !isDown ? NewPhase.Ended : began ? NewPhase.Began : NewPhase.Moved });
        }
        else
        {
            UnityEngine.InputSystem.Mouse mouse = UnityEngine.InputSystem.Mouse.current;
            mouse.position.Value = place;
            mouse.leftButton.isPressed = isDown;
            mouse.leftButton.wasReleasedThisFrame = !isDown;
        }
    }

    static void Stroke(float xMm, float yMm, string region)
    {
        Heard.Clear();
        for (int i = 0; i < 20; i++)
        {
            Put(xMm + i, yMm, true);
            Frame();
        }
        Put(xMm + 20, yMm, false);
        Until(() => Heard.Contains("leave " + region), "leave " + region);
        if (!Heard.SequenceEqual(new[] { "enter " + region, "leave " + region })) throw new Exception("heard " + string.Join(", ", Heard));
        Console.WriteLine("felt " + region);
    }

    static LayoutUnderFinger Load(string region, Rect placeMm, TextAsset layout = null)
    {
        var component = new LayoutUnderFinger { pixelsPerMm = PxPerMm, layout = layout };
        if (region != null) component.regions.Add(new FeltRegion { name = region, placeMm = placeMm });
        component.OnContact += e => Heard.Add(e.Event + " " + e.Region);
        var sample = new LogContacts();
        sample.Siblings.Add(component);
        Call(sample, "Awake");
        Call(component, "OnEnable");
        Enabled.Add(component);
        return component;
    }

    static void Unload(LayoutUnderFinger component)
    {
        Enabled.Remove(component);
        Call(component, "OnDisable");
    }

    static bool Plays(LayoutUnderFinger component) { return component.Session != null && component.Session.Output.State == "armed"; }

    static void Scenes()
    {
        // Sizes of the inspector, which turn nothing.
        LayoutUnderFinger first = Load("ribs", new Rect(10f, 20f, 60f, 30f));
        Until(() => Plays(first), "armed");
        Stroke(15f, 45f, "ribs");
        Time.timeScale = 0f; // a menu; the finger is felt all the same
        Stroke(15f, 25f, "ribs");
        Time.timeScale = 1f;

        // A window that loses the focus hears of its fingers no more.
        Heard.Clear();
        Put(20f, 30f, true);
        Until(() => Heard.Contains("enter ribs"), "enter ribs");
        Input.Touches.Clear();
        EnhancedTouch.All.Clear();
        if (UnityEngine.InputSystem.Mouse.current != null) UnityEngine.InputSystem.Mouse.current.leftButton.isPressed = false;
        Call(first, "OnApplicationFocus", false);
        Until(() => Heard.Contains("leave ribs"), "leave ribs");

        // A second scene beside the first: its regions come to the first's, and stay when that is gone.
        LayoutUnderFinger second = Load("rim", new Rect(100f, 20f, 60f, 30f));
        Until(() => Plays(second), "the second scene");
        Stroke(105f, 30f, "rim");
        Stroke(15f, 30f, "ribs");
        Unload(first);
        Stroke(105f, 30f, "rim");

        // A second scene in the place of the first, with a layout of the studio.
        Unload(second);
        LayoutUnderFinger third = Load(null, new Rect(), new TextAsset(System.IO.File.ReadAllText(Environment.GetEnvironmentVariable("LAYOUT"))));
        Until(() => Plays(third), "the scene in its place");
        Stroke(15f, 30f, "ribs");
        Unload(third);
    }

    static int Main(string[] arguments)
    {
        _input = arguments[0];
        Input.IsOn = arguments[1] != "new"; // what the project's settings have
        if (_input == "mouse") UnityEngine.InputSystem.Mouse.current = new UnityEngine.InputSystem.Mouse();
        SynchronizationContext.SetSynchronizationContext(Loop);
        Scenes();
        return 0;
    }
}
