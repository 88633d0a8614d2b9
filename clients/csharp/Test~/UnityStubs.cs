// The names of Unity that the component and the sample use, so that they compile without Unity.
namespace UnityEngine
{
    using System;

    public class Object { }
    public class MonoBehaviour : Object { public T GetComponent<T>() { return default(T); } }
    public class TextAsset : Object { public string text { get { return ""; } } }
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

    public static class Input
    {
        public static int touchCount { get { return 0; } }
        public static Vector3 mousePosition { get { return new Vector3(); } }
        public static Touch GetTouch(int index) { return new Touch(); }
        public static bool GetMouseButton(int button) { return false; }
        public static bool GetMouseButtonDown(int button) { return false; }
        public static bool GetMouseButtonUp(int button) { return false; }
    }

    public static class Screen
    {
        public static float dpi { get { return 96f; } }
        public static int height { get { return 1080; } }
    }

    public static class Application
    {
        public static string productName { get { return "stub"; } }
        public static string streamingAssetsPath { get { return ""; } }
    }

    public static class Debug
    {
        public static void Log(object message) { }
        public static void Log(object message, Object context) { }
        public static void LogException(Exception error, Object context) { }
    }

    public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string name) { } }
    public sealed class ContextMenu : Attribute { public ContextMenu(string name) { } }
    public sealed class DisallowMultipleComponent : Attribute { }
    public sealed class RequireComponent : Attribute { public RequireComponent(Type type) { } }
    public sealed class RangeAttribute : Attribute { public RangeAttribute(float low, float high) { } }
    public sealed class TextAreaAttribute : Attribute { public TextAreaAttribute(int least, int most) { } }
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
}
