// Fingers and the mouse, by whichever of Unity's input systems the project has.
namespace Haptix
{
    using System.Collections.Generic;
    using UnityEngine;
#if HAPTIX_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
    using UnityEngine.InputSystem;
    using UnityEngine.InputSystem.Controls;
    using UnityEngine.InputSystem.EnhancedTouch;
    using Finger = UnityEngine.InputSystem.EnhancedTouch.Touch;
    using Phase = UnityEngine.InputSystem.TouchPhase;
#else
    using Finger = UnityEngine.Touch;
    using Phase = UnityEngine.TouchPhase;
#endif

    static class Fingers
    {
        const int MouseId = 255;
        static readonly List<TouchReport> Reports = new List<TouchReport>();
        static readonly HashSet<int> Down = new HashSet<int>();

        /// <summary>Report what has come since the last frame, in one batch.</summary>
        public static void Report(Session session)
        {
            Reports.Clear();
            Read();
            if (Reports.Count > 0) session.Touches(Reports);
        }

        /// <summary>Lift all: the window hears of them no more.</summary>
        public static void Lift(Session session)
        {
            Reports.Clear();
            foreach (int id in Down) Reports.Add(new TouchReport { TimeS = Session.NowS, TouchId = id, Kind = TouchKind.Up });
            Down.Clear();
            if (Reports.Count > 0) session.Touches(Reports);
        }

        static void Add(int id, Phase phase, Vector2 place)
        {
            bool ends = phase == Phase.Ended || phase == Phase.Canceled;
            if (ends && !Down.Remove(id)) return;
            TouchKind kind = ends ? TouchKind.Up : Down.Add(id) ? TouchKind.Down : TouchKind.Move;
            // The frame's time is the nearest that both systems tell. Unity counts pixels from below.
            Reports.Add(new TouchReport {
                TimeS = Session.NowS, TouchId = id, Kind = kind, InPixels = true, X = place.x, Y = Screen.height - place.y });
        }

#if HAPTIX_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
        public static void Begin() { EnhancedTouchSupport.Enable(); }

        public static void End() { EnhancedTouchSupport.Disable(); }

        static void Read()
        {
            // By the finger's place in the list: `touchId` is another with each touch, without end.
            foreach (Finger touch in Finger.activeTouches) Add(touch.finger.index, touch.phase, touch.screenPosition);
            if (Finger.activeTouches.Count > 0) return;
            if (Pen.current != null && Press(Pen.current, Pen.current.tip)) return;
            if (Mouse.current != null) Press(Mouse.current, Mouse.current.leftButton);
        }

        static bool Press(Pointer pointer, ButtonControl button)
        {
            if (!button.isPressed && !button.wasReleasedThisFrame) return false;
            Add(MouseId, button.isPressed ? Phase.Moved : Phase.Ended, pointer.position.ReadValue());
            return true;
        }
#elif ENABLE_INPUT_SYSTEM && !ENABLE_LEGACY_INPUT_MANAGER
        public static void Begin() { Debug.LogError("haptix: install the package Input System, which this project's settings name"); }

        public static void End() { }

        static void Read() { }
#else
        public static void Begin() { }

        public static void End() { }

        static void Read()
        {
            for (int i = 0; i < Input.touchCount; i++)
            {
                Finger touch = Input.GetTouch(i);
                Add(touch.fingerId, touch.phase, touch.position);
            }
            if (Input.touchCount > 0) return;
            if (Input.GetMouseButton(0)) Add(MouseId, Phase.Moved, Input.mousePosition);
            else if (Input.GetMouseButtonUp(0)) Add(MouseId, Phase.Ended, Input.mousePosition);
        }
#endif
    }
}
