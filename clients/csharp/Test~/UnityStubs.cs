// The names of Unity that the package and the sample use, so that they compile and run without Unity.
// `Player` of tests sets what a person and the engine would.
namespace UnityEngine
{
    using System;
    using System.Collections.Generic;

    public class Object { }

    public class MonoBehaviour : Object
    {
        public readonly List<Object> Siblings = new List<Object>();

        public T GetComponent<T>() where T : class
        {
            foreach (Object one in Siblings) if (one is T) return (T)(object)one;
            return null;
        }
    }

    public class TextAsset : Object
    {
        readonly string _text;
        public TextAsset(string text) { _text = text; }
        public string text { get { return _text; } }
    }

    public enum TouchPhase { Began, Moved, Stationary, Ended, Canceled }

    public struct Vector2
    {
        public float x, y;
        public static implicit operator Vector2(Vector3 place) { return new Vector2 { x = place.x, y = place.y }; }
    }

    public struct Vector3 { public float x, y, z; }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height) : this()
        {
            this.x = x;
            this.y = y;
            this.width = width;
            this.height = height;
        }

        public float x { get; set; }
        public float y { get; set; }
        public float width { get; set; }
        public float height { get; set; }
    }

    public struct Touch
    {
        public int fingerId { get; set; }
        public TouchPhase phase { get; set; }
        public Vector2 position { get; set; }
    }

    /// <summary>The old input system; as in Unity it throws where the project has only the new one.</summary>
    public static class Input
    {
        public static bool IsOn = true;
        public static readonly List<Touch> Touches = new List<Touch>();
        public static Vector3 Place;
        public static bool IsHeld, IsReleased;

        static T Told<T>(T value)
        {
            if (!IsOn) throw new InvalidOperationException("You are trying to read Input using the UnityEngine.Input class, but you have switched active Input handling to Input System package in Player Settings.");
            return value;
        }

        public static int touchCount { get { return Told(Touches.Count); } }
        public static Vector3 mousePosition { get { return Told(Place); } }
        public static Touch GetTouch(int index) { return Told(Touches[index]); }
        public static bool GetMouseButton(int button) { return Told(IsHeld); }
        public static bool GetMouseButtonUp(int button) { return Told(IsReleased); }
    }

    public static class Screen
    {
        public static float dpi { get { return 0f; } }
        public static int height { get { return 1080; } }
    }

    public static class Time
    {
        public static float timeScale = 1f;
    }

    public static class Application
    {
        public static string productName { get { return "stub"; } }
        public static string streamingAssetsPath { get { return ""; } }
    }

    public static class Debug
    {
        public static readonly List<string> Errors = new List<string>();

        public static void Log(object message) { Console.WriteLine("log " + message); }
        public static void Log(object message, Object context) { Log(message); }
        public static void LogWarning(object message, Object context) { Log(message); }
        public static void LogError(object message) { Errors.Add(message.ToString()); }
        public static void LogException(Exception error, Object context) { Errors.Add(error.ToString()); }
    }

    public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string name) { } }
    public sealed class ContextMenu : Attribute { public ContextMenu(string name) { } }
    public sealed class DisallowMultipleComponent : Attribute { }
    public sealed class RequireComponent : Attribute { public RequireComponent(Type type) { } }
    public sealed class RangeAttribute : Attribute { public RangeAttribute(float low, float high) { } }
    public sealed class TextAreaAttribute : Attribute { public TextAreaAttribute(int least, int most) { } }
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
}

namespace UnityEngine.InputSystem
{
    using UnityEngine.InputSystem.Controls;

    public enum TouchPhase { None, Began, Moved, Ended, Canceled, Stationary }

    public class Pointer
    {
        public Vector2Control position = new Vector2Control();
    }

    public class Mouse : Pointer
    {
        public static Mouse current;
        public ButtonControl leftButton = new ButtonControl();
    }

    public class Pen : Pointer
    {
        public static Pen current;
        public ButtonControl tip = new ButtonControl();
    }
}

namespace UnityEngine.InputSystem.Controls
{
    public class Vector2Control
    {
        public Vector2 Value;
        public Vector2 ReadValue() { return Value; }
    }

    public class ButtonControl
    {
        public bool isPressed { get; set; }
        public bool wasReleasedThisFrame { get; set; }
    }
}

namespace UnityEngine.InputSystem.EnhancedTouch
{
    using System;
    using System.Collections.Generic;

    public class Finger { public int index { get; set; } }

    public struct Touch
    {
        public static readonly List<Touch> All = new List<Touch>();
        public static List<Touch> activeTouches
        {
            get
            {
                if (EnhancedTouchSupport.Users == 0) throw new InvalidOperationException("EnhancedTouch API is not enabled");
                return All;
            }
        }
        public Finger finger { get; set; }
        public int touchId { get; set; }
        public TouchPhase phase { get; set; }
        public Vector2 screenPosition { get; set; }
    }

    public static class EnhancedTouchSupport
    {
        public static int Users;
        public static void Enable() { Users++; }
        public static void Disable() { Users--; }
    }
}
