using Haptix;
using UnityEngine;

/// <summary>Logs each contact with a region of the layout on the same object.</summary>
[RequireComponent(typeof(LayoutUnderFinger))]
public class LogContacts : MonoBehaviour
{
    void Awake()
    {
        GetComponent<LayoutUnderFinger>().OnContact += e => Debug.Log(e.Event + " " + e.Region);
    }
}
